cdef double _OUTAGE, _GRADUAL_K, _WARMED

@cython.locals(ambient_degC=double, above_K=double)
cdef Py_ssize_t _breach(Expected plan, Memory memory, Py_ssize_t j, double cell, double since_s) noexcept nogil
@cython.locals(gap_s=double, breach=Py_ssize_t)
cdef bint _take_cell(Expected plan, Memory memory, Py_ssize_t j, double cell, bint faulted, double true_s) noexcept nogil
@cython.locals(usual_s=double)
cdef double _limit_s(Expected plan, Memory memory, Py_ssize_t j) noexcept nogil
cdef double _driven_m_s(Expected plan, Memory memory, Py_ssize_t p, double true_s) noexcept nogil
@cython.locals(k=Py_ssize_t, paths=Py_ssize_t, true_s=double, usual_s=double, age=double, late=bint)
cpdef void walk_rows(const double[::1] time_s, const double[::1] late_s, const unsigned char[::1] step, const double[:, ::1] cells, const unsigned char[:, ::1] present, const unsigned char[:, ::1] faulted, Expected plan, Memory memory, double[::1] tick_s, double[::1] dt_s, double[:, ::1] values, unsigned char[:, ::1] fresh, signed char[:, ::1] quality, double[:, ::1] age_s, double[:, :, ::1] samples, Py_ssize_t[:, ::1] offset, Py_ssize_t[::1] end, unsigned char[::1] counts) noexcept nogil
