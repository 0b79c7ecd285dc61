cdef Py_ssize_t _LAST, _DELTA, _BEND, _BEND_BEFORE, _RUN, _LONGEST, _SEEN
cdef double _MEMORY_SAMPLES, _YOUNG_SAMPLES, _REPEATS, _PATIENCE, _LONGEST_KNOWN, _NOISE_SEEN

@cython.locals(last=double, delta=double, samples=double, limit=double)
cdef bint is_stuck(double[::1] memory, double value, double noise_K) noexcept nogil
