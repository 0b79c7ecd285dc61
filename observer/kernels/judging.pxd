cdef Py_ssize_t RELEASE_AFTER_STEPS, STALE_AFTER_STEPS
cdef double REOPEN_AFTER_S, REOPEN_EVERY_S, HELD_BACK_S, LOST_S, QUIET_S, _REOPEN_AT_LEAST, _REOPEN_SIGMA, _AGREES

cdef inline void forget(double[:, ::1] rows, Py_ssize_t k) noexcept nogil

@cython.locals(total=double)
cdef inline bint step_is_finite(Inputs u, Py_ssize_t k) noexcept nogil
cdef inline Py_ssize_t find_usable(Inputs u, Py_ssize_t k, unsigned char[::1] usable) noexcept nogil
cdef inline bint gate(double[::1] S, double gate_sigma, Running state, Work work) noexcept nogil
@cython.locals(due=bint)
cdef inline void defer_readmitted(Running state, Work work) noexcept nogil
@cython.locals(share=double)
cdef inline double readmit(PlantArrays p, double dt_s, bint released, bint model_may_be_wrong, Running state, Work work) noexcept nogil
@cython.locals(released=bint)
cdef inline bint refuse(double[::1] S, double gate_sigma, bint model_may_be_wrong, Running state, Work work) noexcept nogil
cdef inline void inflate_for_lost_position(PlantArrays p, Inputs u, Py_ssize_t k, double[::1] lost_s, double[:, ::1] P) noexcept nogil
@cython.locals(variance=double)
cdef double _share_of_prior(PlantArrays p, double[:, ::1] C, Py_ssize_t i, double nu) noexcept nogil
cdef void add_prior(PlantArrays p, double[:, ::1] P, double share) noexcept nogil
cdef inline Py_ssize_t judge(Inputs u, Py_ssize_t k, unsigned char[::1] usable, unsigned char[::1] accepted, Running state, Results out) noexcept nogil
cdef inline Py_ssize_t judge_screening(ScreeningVerdict *verdict, double time_s) noexcept nogil
cdef void skip(Inputs u, Py_ssize_t k, unsigned char[::1] usable, Running state, Results out) noexcept nogil
cdef inline void write_innovations(double[::1] nu, double[::1] S, unsigned char[::1] usable, Py_ssize_t k, Results out) noexcept nogil
cdef void invalidate(Results out, Py_ssize_t k) noexcept nogil
cdef inline void rate(Results out, Py_ssize_t k, Py_ssize_t quality) noexcept nogil
cdef inline void move_rows(PlantArrays p, Inputs u, Py_ssize_t k, double[:, ::1] rows) noexcept nogil
cdef inline bint write_values(PlantArrays p, Inputs u, Py_ssize_t k, Running state, Work work, Results out) noexcept nogil
cdef inline bint write_sigmas(Running state, Py_ssize_t k, Work work, Results out) noexcept nogil
cdef inline void clear(double[:, ::1] P) noexcept nogil
@cython.locals(is_valid=bint)
cdef inline bint write_step(PlantArrays p, Inputs u, Py_ssize_t k, Running state, Work work, Results out) noexcept nogil
@cython.locals(released=bint)
cdef inline bint judge_sensors(PlantArrays p, Inputs u, Py_ssize_t k, double gate_sigma, Running state, Work work) noexcept nogil
