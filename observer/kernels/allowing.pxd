cdef void begin_allowing(Allowed a, Inputs u, Py_ssize_t k, double[::1] x) noexcept nogil
cdef void allow(Allowed a, StepTable t, Py_ssize_t d, Inputs u, Py_ssize_t k) noexcept nogil
@cython.locals(off=double)
cdef void allow_for_readings(Allowed a, double[::1] S_nu) noexcept nogil
cdef void correct_allowed(Allowed a, double[:, ::1] K, unsigned char[::1] accepted) noexcept nogil
@cython.locals(rest=double)
cdef void correct_allowed_jointly(Allowed a, unsigned char[::1] accepted, double[:, ::1] L, double[:, ::1] W, Py_ssize_t[::1] order) noexcept nogil
cdef inline void finish_allowing(Allowed a, double dt_s, double[::1] x) noexcept nogil
@cython.locals(variance=double)
cdef void widen(Allowed a, double[:, ::1] rows, Py_ssize_t k, Results out) noexcept nogil
