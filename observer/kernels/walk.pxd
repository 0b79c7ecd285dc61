cdef double _SIMULTANEOUS

@cython.locals(last_s=double, apart_s=double)
cdef Py_ssize_t even_out(double[:, ::1] samples, Py_ssize_t begin, Py_ssize_t end, double[::1] passed, double period_s) noexcept nogil
@cython.locals(place=Py_ssize_t, retained=Py_ssize_t, before_s=double, before_m=double, since_s=double)
cdef Py_ssize_t _in_order(double[:, ::1] samples, Py_ssize_t begin, Py_ssize_t end, double[::1] passed, double period_s) noexcept nogil

cdef double _MEMORY_SAMPLES, _YOUNG_SAMPLES, _REPEATS, _PATIENCE, _LONGEST_KNOWN, _NOISE_SEEN

@cython.locals(last=double, delta=double, samples=double, limit=double)
cdef bint is_stuck(ChannelNoise *noise, double value, double noise_K) noexcept nogil

cdef double _OUTAGE, GRADUAL_K, WARMED
cdef Py_ssize_t ABOVE_AMBIENT

@cython.locals(in_degC=double, other_degC=double, k=Py_ssize_t)
cdef bint _beside_a_warm_one(Expected plan, Memory memory, Py_ssize_t j, double cell, double ambient_degC) noexcept nogil

@cython.locals(ambient_degC=double, above_K=double)
cdef Py_ssize_t _breach(Expected plan, Memory memory, Py_ssize_t j, double cell, double since_s) noexcept nogil
@cython.locals(gap_s=double, breach=Py_ssize_t)
cdef bint _take_cell(Expected plan, Memory memory, Py_ssize_t j, double cell, bint faulted, double true_s) noexcept nogil
cdef double _usual_s(Expected plan, Memory memory, Py_ssize_t j) noexcept nogil
@cython.locals(usual_s=double)
cdef double _limit_s(Expected plan, Memory memory, Py_ssize_t j) noexcept nogil
cdef double _driven_m_s(Expected plan, Memory memory, Py_ssize_t p, double true_s) noexcept nogil
@cython.locals(k=Py_ssize_t, paths=Py_ssize_t, speed=Py_ssize_t, true_s=double, usual_s=double, age=double, late=bint)
cpdef void walk_rows(Rows rows, Py_ssize_t count, Expected plan, Memory memory, Frames frames) noexcept nogil
