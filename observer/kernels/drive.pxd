@cython.locals(hours=double, hours_before=double, ready=bint, column=Py_ssize_t)
cpdef void fill_inputs(ColumnsRead read, const double[::1] time_s, const double[:, ::1] values, const unsigned char[:, ::1] fresh, const signed char[:, ::1] quality, const double[::1] law_before_W, const double[::1] z_before, double begin_s, double last_s, double[:, ::1] law, double[:, ::1] known, double[:, ::1] z_start, double[:, ::1] z_end, double[:, ::1] law_W, double[:, ::1] jump_W, double[:, ::1] y_degC, unsigned char[:, ::1] usable, signed char[:, ::1] sensor_quality, signed char[::1] degraded) noexcept nogil
@cython.locals(ready=bint, before=double, start=double)
cdef inline bint _fill_known(ColumnsRead read, const double[:, ::1] values, const double[::1] z_before, Py_ssize_t k, double hours, double hours_before, double[:, ::1] known, double[:, ::1] z_start, double[:, ::1] z_end) noexcept nogil
@cython.locals(before=double)
cdef inline void _fill_laws(const double[::1] law_before_W, Py_ssize_t k, double[:, ::1] law, double[:, ::1] law_W, double[:, ::1] jump_W) noexcept nogil
