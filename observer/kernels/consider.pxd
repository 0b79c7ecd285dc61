cdef void begin_considered(Considered a, Inputs u, Py_ssize_t k, double[::1] x) noexcept nogil
cdef void propagate_considered(Considered a, Batch b, Py_ssize_t k) noexcept nogil
@cython.locals(off=double)
cdef void consider_readings(Considered a, double[::1] S_nu) noexcept nogil
cdef void correct_considered(Considered a, double[:, ::1] K, unsigned char[::1] accepted) noexcept nogil
@cython.locals(rest=double)
cdef void correct_considered_jointly(Considered a, Work work) noexcept nogil
cdef inline void finish_considered(Considered a, double dt_s, double[::1] x) noexcept nogil
@cython.locals(variance=double)
cdef void add_considered(Considered a, double[:, ::1] rows, Py_ssize_t k, Results out) noexcept nogil
