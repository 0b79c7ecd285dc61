cdef Py_ssize_t SPAN_S, DUE_S, DEGRADED
cdef double ANSWER_S

@cython.locals(dt_s=double, weight=double)
cdef bint gather(Inputs u, Py_ssize_t k, Gathered g) noexcept nogil
@cython.locals(span_s=double, doubted=bint)
cpdef void pour(Gathered g, Running state, Inputs u) noexcept nogil
cdef void open_again(PlantArrays p, Running state, double[:, ::1] P) noexcept nogil
@cython.locals(variance_K2=double)
cdef void pass_left_out(PlantArrays p, Inputs u, unsigned char[::1] uses, unsigned char[::1] free, double common_K, Running state, Work work, double[::1] misfit) noexcept nogil
cdef void predict_on(PlantArrays p, StepTable t, Inputs u, Py_ssize_t d, Gathered g, Work work) noexcept nogil
@cython.locals(state=Running, result=Results)
cpdef run_bank(PlantArrays p, StepTable t, Inputs u, Py_ssize_t[::1] step, Gathered g, Py_ssize_t drifting, double walk_K2, tuple filters, unsigned char[:, ::1] uses, Running main, double gate_sigma, tuple results, Work work, double[:, ::1] misfit, double[:, ::1] S)
@cython.locals(jump_W=double)
cdef inline double add_change(PlantArrays p, Inputs u, Py_ssize_t k, Held held, Py_ssize_t j) noexcept nogil
@cython.locals(bound=double, part=Py_ssize_t, variance_W2=double)
cpdef void put_bounds(PlantArrays p, Inputs u, Results out, Py_ssize_t k, Held held, double sigmas) noexcept nogil
cpdef Py_ssize_t run_until_due(PlantArrays p, StepTable t, Inputs u, Py_ssize_t[::1] step, Running state, double gate_sigma, Results out, Work work, Gathered g, Held held, double sigmas, Py_ssize_t first) noexcept nogil
