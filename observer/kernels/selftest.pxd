cdef double[2] WINDOWS_S, _BIAS, _COLOUR, _LAW_WINDOWS_S, _OFF_LAW, _ALL_OFF_LAW
cdef double _SURE_SE, _LASTING, _NOISE, _CLEAR, _CLEAN, _CLIP, _CLIP_LAW, KNOWN_SHARE, _PEAK_S, _FLOOR, _LEAST_W, _MOTION_S, _MOTION_ENOUGH
cdef double GREATEST_ACCELERATION_m_s2, GREATEST_SPEED_m_s, SKEW_S, ROUNDED_m, _WAY_SHARE, _SAMPLES_FIRST
cdef double _LATENESS_FADES_S, _STOPPED_S, _UNEXPLAINED, _LONGEST_REFRESH_S, _UNUSUAL, _OPEN_S, _AGREE_S, _AGREE_TRAVELS
cdef double DISAGREE, FALLS_SHORT
cdef Py_ssize_t OF_SENSOR, OF_HEAT

@cython.locals(nut="NutMotion*", stroke_m=double, since_s=double, way_m=double, allowed_m=double, fade=double, open_s=double, open_m=double, farther_m=double, shorter_m=double, held_s=double, began_s=double, jumped=bint)
cpdef void compare_ways(NutPath path, const double[::1] travel_m, NutMotion[::1] memory, MotionStep[:] motion, signed char[::1] degraded) noexcept nogil
@cython.locals(change_m_s=double, gained_m=double, way_m=double)
cpdef double longest_way(double before_m_s, double after_m_s, double unsure_m_s, double elapsed_s) noexcept nogil
@cython.locals(since_s=double, before_m_s=double, elapsed_s=double, late_s=double, repeats_s=double, unsure_m_s=double, allowed_m=double, mean_m=double, jump_m=double)
cdef bint _look_for_jump(NutMotion *nut, double time_s, double way_m, double driven_m_s, double speed_age_s) noexcept nogil
@cython.locals(longer_s=double, most_s=double)
cdef void _time_the_poll(NutMotion *nut, double since_s, double way_m, double driven_m_s) noexcept nogil
@cython.locals(place_m=double, jump_m=double, beyond_m=double)
cdef void _compare_with_travel(NutMotion *nut, const double[::1] travel_m) noexcept nogil
@cython.locals(confirmed=bint)
cdef bint jump_stands(NutMotion *nut, MotionStep *step, double dt_s, bint agree) noexcept nogil
cdef bint _is_any_used(Tested u, Py_ssize_t k) noexcept nogil
@cython.locals(failing=bint)
cdef inline void _note(SelfTestState state, Py_ssize_t test, double score, double time_s, double value, double expected) noexcept nogil
@cython.locals(before=double, since_s=double, share=double, window="InnovationWindow*")
cdef void _average_innovation(SelfTestState state, Py_ssize_t i, double nu, double lasting, double time_s) noexcept nogil
@cython.locals(window="InnovationWindow*", minute="InnovationWindow*", longer="InnovationWindow*", colour=double, noise=double, sure=double, lasting=double, clean=bint)
cdef inline void _scores(SelfTestState state, Py_ssize_t i, double[::1] scores) noexcept nogil
cdef inline void forget_window(InnovationWindow *window) noexcept nogil
@cython.locals(score=double, clipped=double)
cdef inline double _off_law(SelfTestState state, Py_ssize_t row, double distance, double dt_s, double* limit, double slack) noexcept nogil
cdef inline bint _fails(SelfTestState state, Py_ssize_t test) noexcept nogil
cdef inline bint _is_refused(Tested u, Py_ssize_t k, Py_ssize_t i) noexcept nogil
@cython.locals(refused=double)
cdef inline void _forget_after_refusals(SelfTestState state, Tested u, Py_ssize_t k) noexcept nogil
@cython.locals(refused=bint, test=Py_ssize_t, has_value=bint, last=double, long=double, mean=double, product=double, square=double, failing=bint, nu=double, lasting=double)
cdef inline bint _test_sensor(SelfTestState state, Tested u, Py_ssize_t k, Py_ssize_t i, Trust trust, double[::1] scores) noexcept nogil
@cython.locals(law_W=double, trusted_W=double, floor_W=double)
cdef inline double _distance(SelfTestState state, Tested u, Py_ssize_t k, Py_ssize_t j, double uncertainty) noexcept nogil
@cython.locals(total=double, laws=Py_ssize_t, failing=bint, starting=bint, sigma_W=double, needed_W=double, test=Py_ssize_t, unknown=bint, distance=double, score=double)
cdef inline (bint, bint) _test_heats(SelfTestState state, Tested u, Py_ssize_t k, Trust trust, Py_ssize_t base) noexcept nogil
@cython.locals(failing=bint, starting=bint, sensors_agree=bint, jump_remains=bint, step="MotionStep*", test=Py_ssize_t, score=double)
cpdef void run_selftest(Tested u, Trust trust, SelfTestState state, signed char[::1] quality, signed char[:, ::1] part_quality, double[::1] scores) noexcept nogil
