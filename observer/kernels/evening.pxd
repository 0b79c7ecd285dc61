cdef double _TOGETHER

@cython.locals(last_s=double, apart_s=double)
cdef Py_ssize_t even_out(double[:, ::1] samples, Py_ssize_t begin, Py_ssize_t end, double[::1] passed, double period_s) noexcept nogil
@cython.locals(place=Py_ssize_t, kept=Py_ssize_t, before_s=double, before_m=double, since_s=double)
cdef Py_ssize_t _in_order(double[:, ::1] samples, Py_ssize_t begin, Py_ssize_t end, double[::1] passed, double period_s) noexcept nogil
