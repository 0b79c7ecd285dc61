cdef double hold(double rate_1_s, double dt_s) noexcept nogil
@cython.locals(u=double)
cdef double ramp(double rate_1_s, double dt_s) noexcept nogil
@cython.locals(slow=double)
cdef double respond(double rate_1_s, double heat_rate_1_s, double dt_s) noexcept nogil
@cython.locals(dt_s=double, s=double, weight=double, decayed=double)
cpdef void discretise(const double[::1] rate, const double[::1] heat_rate, const double[::1] intensity, const double[::1] nodes, const double[::1] weights, double[::1] response, StepMatrices step) noexcept nogil
@cython.locals(count=Py_ssize_t, number=Py_ssize_t, length=double)
cpdef (Py_ssize_t, Py_ssize_t) number_steps(const double[::1] dt_s, Py_ssize_t start, Py_ssize_t[::1] step, double[::1] lengths) noexcept nogil
