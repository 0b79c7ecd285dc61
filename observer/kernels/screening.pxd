cdef double JUMP_SIGMA, LEAST_JUMP_K, DRIFT_K_S, YOUNG_S, _QUIET_S, _LEAST_SAMPLES, _MEAN_S, LASTS_SAMPLES, LASTS_S
cdef double _EQUAL_K, _EQUAL_SIGMA, _BACK, _TELLING, _UNREST, _UNREST_SHARE, _EXCESS_S, READMIT_S, _READMIT_SIGMA
cdef double _READMIT_K2, _COMMON_K2, _APART_K2, _SURPRISE_K2, DECIDED_S, _SETTLING_S, _SURPRISED_S, _TRUST_AIR_K
cdef double _LEAST_LEAP_K, _LEAP_K_S, _CLEARLY_OFF

@cython.locals(opened=bint)
cdef bint screen(PlantArrays p, Inputs u, Py_ssize_t k, double gate_sigma, Running state, Work work) noexcept nogil
cdef inline void pass_time(Inputs u, Py_ssize_t k, ScreeningVerdict *verdict) noexcept nogil
@cython.locals(air_degC=double, leap_K=double)
cdef inline void watch_air(PlantArrays p, Inputs u, Py_ssize_t k, ScreeningVerdict *verdict) noexcept nogil
@cython.locals(judged=bint, step_K=double, limit_K=double)
cdef inline void look_at(Py_ssize_t i, SensorGuard *sensor, double age_s, Running state, Work work) noexcept nogil
cdef inline void settle(SensorGuard *sensor) noexcept nogil
@cython.locals(decided=bint, lasted=bint)
cdef inline bint is_decided(SensorGuard[::1] guard) noexcept nogil
@cython.locals(mean_K=double, other=Py_ssize_t)
cdef bint decide(PlantArrays p, Inputs u, Py_ssize_t k, Running state) noexcept nogil
@cython.locals(first=Py_ssize_t, second=Py_ssize_t)
cdef Py_ssize_t swapped_with(PlantArrays p, SensorGuard[::1] guard) noexcept nogil
cdef void exclude(Inputs u, Py_ssize_t k, Py_ssize_t i, Py_ssize_t cause, Running state) noexcept nogil
cdef inline void forget_step(SensorGuard *sensor) noexcept nogil
@cython.locals(equal=bint, factor=double, variance_K2=double, free=Py_ssize_t)
cdef void open_all(PlantArrays p, Inputs u, Py_ssize_t k, double mean_K, Running state) noexcept nogil
@cython.locals(product=double, square=double, factor=double)
cdef double gain_of(PlantArrays p, Inputs u, Py_ssize_t k, SensorGuard[::1] guard) noexcept nogil
cdef Py_ssize_t offset_of(PlantArrays p, Py_ssize_t i) noexcept nogil
cdef bint open_offset(PlantArrays p, Py_ssize_t i, double variance_K2, double[:, ::1] P) noexcept nogil
cdef void open_common(PlantArrays p, double variance_K2, double[:, ::1] P) noexcept nogil
@cython.locals(young=bint, released=bint, share=double)
cdef bint refuse_or_settle(PlantArrays p, Inputs u, Py_ssize_t k, double gate_sigma, Running state, Work work) noexcept nogil
@cython.locals(size_K=double, back_K=double, exchanged=bint, clear=bint, proves=bint, near=bint)
cdef inline void look_for_return(SensorGuard *sensor, double since_s, double noise_K, double nu, double sigma_K) noexcept nogil
@cython.locals(share=double)
cdef bint remember(PlantArrays p, Inputs u, Py_ssize_t k, Py_ssize_t i, Running state, Work work) noexcept nogil
