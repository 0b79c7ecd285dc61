cdef double[2] WINDOWS_S, _BIAS, _COLOUR, _LAW_WINDOWS_S, _OFF_LAW, _ALL_OFF_LAW
cdef double _SURE_SE, _LASTING, _NOISE, _CLEAR, _CLEAN, _CLIP, _CLIP_LAW, _KNOWN, _PEAK_S, _FLOOR, _LEAST_W, _MOTION_S, _MOTION_ENOUGH
cdef double DISAGREE, FALLS_SHORT
cdef double _LEAP_M, _LEAP_USUAL, _LEAP_SAMPLES, _LEAP_S, _WHOLE, _STAYS_LATE_S, _UNUSUAL
cdef Py_ssize_t OF_SENSOR, OF_HEAT, WAS, SHORT, USUAL, LEAP, SAMPLES, HIDDEN, STOOD, ASTRAY, EVERY_S, LATE_S, OF_MOTION

@cython.locals(since_s=double, allowed_m=double, fade=double)
cpdef void compare_ways(const double[::1] sample_s, const double[::1] sample_m, const Py_ssize_t[::1] offset, const double[::1] driven_m_s, double stroke_m, double[::1] memory, double[:] ratio, double[:] leap_m, signed char[::1] degraded) noexcept nogil
@cython.locals(most_m=double, least_m=double, beyond_m=double, longer_s=double, before_s=double, held_up_s=double, usual_m=double, late_m=double, steady=bint, leap_m=double, short_m=double, whole=bint, back=bint)
cdef void _look_for_leap(double[::1] memory, double way_m, double driven_m_s, double since_s) noexcept nogil
@cython.locals(failing=bint)
cdef inline void _note(SelfTestState state, Py_ssize_t test, double score, double time_s, double value, double expected) noexcept nogil
@cython.locals(before=double, since_s=double, share=double)
cdef void _average_innovation(SelfTestState state, Py_ssize_t i, double nu, double lasting, double time_s) noexcept nogil
@cython.locals(mean=double, product=double, square=double, sure=double, lasting=double, clean=bint)
cdef inline void _scores(SelfTestState state, Py_ssize_t i, double[::1] scores) noexcept nogil
@cython.locals(score=double, clipped=double)
cdef inline double _off_law(SelfTestState state, Py_ssize_t row, double distance, double dt_s, double* limit, double slack) noexcept nogil
cdef inline bint _fails(SelfTestState state, Py_ssize_t test) noexcept nogil
cdef inline bint _is_refused(Tested u, Py_ssize_t k, Py_ssize_t i) noexcept nogil
@cython.locals(refused=double)
cdef inline void _forget_after_refusals(SelfTestState state, Tested u, Py_ssize_t k) noexcept nogil
@cython.locals(refused=bint, test=Py_ssize_t, came=bint, last=double, long=double, mean=double, product=double, square=double, failing=bint, nu=double, lasting=double)
cdef inline bint _test_sensor(SelfTestState state, Tested u, Py_ssize_t k, Py_ssize_t i, Trust trust, double[::1] scores) noexcept nogil
@cython.locals(law_W=double, trusted_W=double, floor_W=double)
cdef inline double _distance(SelfTestState state, Tested u, Py_ssize_t k, Py_ssize_t j, double uncertainty) noexcept nogil
@cython.locals(total=double, laws=Py_ssize_t, failing=bint, starting=bint, sigma_W=double, test=Py_ssize_t, unknown=bint, distance=double, score=double)
cdef inline (bint, bint) _test_heats(SelfTestState state, Tested u, Py_ssize_t k, Trust trust, Py_ssize_t base) noexcept nogil
@cython.locals(failing=bint, starting=bint, ratio=double, test=Py_ssize_t, score=double, leap_m=double)
cpdef void run_selftest(Tested u, Trust trust, SelfTestState state, signed char[::1] quality, double[::1] scores) noexcept nogil
