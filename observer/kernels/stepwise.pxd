cdef Py_ssize_t _ITERATIONS
cdef double _DIFFERENCE_W, _REST

cpdef void find_heats_stepwise(const double[::1] decay, const double[:, ::1] held, const double[:, ::1] C, const double[:, ::1] G, const double[:, ::1] rise_K, const double[:, ::1] weight_1_K, double[:, ::1] out, double[::1] x, double[::1] q, double[::1] free, double[::1] gradient, double[::1] direction) noexcept nogil
@cython.locals(enough=double, before=double, first=double, steepness=double, above=double, factor=double, step=double)
cdef void _descend(double[::1] free, const double[:, ::1] G, double[::1] q, const double[::1] y, const double[::1] weight, double[::1] gradient, double[::1] direction) noexcept nogil
@cython.locals(top=double, bottom=double, T=double, change=double)
cdef double _step_along(double[::1] free, const double[:, ::1] G, double[::1] q, double[::1] direction, const double[::1] y, const double[::1] weight) noexcept nogil
@cython.locals(total=double, T=double)
cdef double _misfit(double[::1] free, const double[:, ::1] G, double[::1] q, const double[::1] y, const double[::1] weight) noexcept nogil
