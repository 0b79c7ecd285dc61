cdef Py_ssize_t SKIPPED, STARTED, STEPPED

cdef Py_ssize_t start_or_predict(Batch b, Py_ssize_t k, Running state, Work work) noexcept nogil
@cython.locals(log_likelihood=double, opened=bint)
cdef double judge_and_correct(PlantArrays p, Inputs u, Py_ssize_t k, double gate_sigma, Running state, Work work) noexcept nogil
cdef void filter_steps(Batch b, Running state, Results out, Work work) noexcept nogil
@cython.locals(is_valid=bint)
cdef void filter_part(Batch b, Running state, Results out, Work work, Py_ssize_t first, Py_ssize_t end) noexcept nogil
cpdef run_kalman(Batch b, Running state, Results out, Work work)
