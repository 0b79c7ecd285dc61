cdef unsigned char _COMMA, _NEWLINE, _PLUS, _MINUS, _POINT, _ZERO, _NINE, _E, _SMALL_E
cdef long long _FULL
cdef double _FARTHEST

@cython.locals(rows=Py_ssize_t)
cpdef Py_ssize_t read_rows(const unsigned char[::1] text, Py_ssize_t[::1] column, double[:, ::1] out)
@cython.locals(at=Py_ssize_t, row=Py_ssize_t, cell=Py_ssize_t, begin=Py_ssize_t)
cdef Py_ssize_t _read(const unsigned char[::1] text, Py_ssize_t[::1] column, double[:, ::1] out) noexcept nogil
@cython.locals(at=Py_ssize_t, sign=double, whole="long long", power=Py_ssize_t, digits=Py_ssize_t, after=Py_ssize_t, exponent=double)
cdef double _number(const unsigned char[::1] text, Py_ssize_t begin, Py_ssize_t end) noexcept nogil
@cython.locals(at=Py_ssize_t, sign=double, value=double)
cdef double _exponent(const unsigned char[::1] text, Py_ssize_t begin, Py_ssize_t end) noexcept nogil
@cython.locals(ten=double, left=double)
cdef double _times_ten(long long whole, double power) noexcept nogil
