cdef inline double squared(double value) noexcept nogil
cdef inline double sign(double value) noexcept nogil
@cython.locals(left=double)
cdef inline double remainder(double value, double period) noexcept nogil
