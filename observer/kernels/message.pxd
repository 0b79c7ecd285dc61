cdef inline Py_ssize_t put_piece(Message message, Py_ssize_t at, Py_ssize_t piece) noexcept nogil
@cython.locals(size=Py_ssize_t, mark=Py_ssize_t)
cdef Py_ssize_t put_count(unsigned char[::1] out, Py_ssize_t at, Py_ssize_t count) noexcept nogil
@cython.locals(source="const char*", arrays=Py_ssize_t, first=Py_ssize_t, at=Py_ssize_t)
cpdef encode(Message message, bytes data, Py_ssize_t sequence, Py_ssize_t sensors_used)
