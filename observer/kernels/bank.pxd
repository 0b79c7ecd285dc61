cdef Py_ssize_t SPAN_S, DUE_S, DEGRADED
cdef double ANSWER_S

@cython.locals(dt_s=double, weight=double)
cdef bint gather(Inputs u, Py_ssize_t k, Gathered g) noexcept nogil
@cython.locals(span_s=double, doubted=bint)
cpdef void pour(Gathered g, Running state, Inputs u) noexcept nogil
cdef void open_again(PlantArrays p, Running state, double[:, ::1] P) noexcept nogil
@cython.locals(variance_K2=double, off_K=double)
cdef void pass_left_out(Batch b, BankFilters bank, Py_ssize_t f, Running state) noexcept nogil
cdef void predict_on(Batch b, Gathered g, Work work) noexcept nogil
@cython.locals(state=Running, result=Results, p=PlantArrays, u=Inputs, g=Gathered)
cpdef run_bank(Batch b, BankFilters bank, Running main, double walk_K2)
@cython.locals(jump_W=double)
cdef inline double add_change(PlantArrays p, Inputs u, Py_ssize_t k, BankBounds bounds, Py_ssize_t j) noexcept nogil
@cython.locals(bound=double, part=Py_ssize_t, variance_W2=double)
cpdef void put_bounds(PlantArrays p, Inputs u, Results out, Py_ssize_t k, BankBounds bounds) noexcept nogil
cpdef Py_ssize_t run_until_due(Batch b, Running state, Results out, Work work, Gathered g, BankBounds bounds, Py_ssize_t first) noexcept nogil
