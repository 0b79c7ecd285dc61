cdef inline void move_columns(AdvancePlant p, Inputs u, Py_ssize_t k, double[:, ::1] B, double[:, ::1] C) noexcept nogil
cdef inline void advance(AdvancePlant p, AdvanceTable t, Py_ssize_t d, Inputs u, Py_ssize_t k, double[::1] x, AdvanceWork work) noexcept nogil
cdef inline void put_laws(AdvancePlant p, Inputs u, Py_ssize_t k, double[:, ::1] B, double[::1] x, double[::1] law) noexcept nogil
cdef inline void advance_diagonal(AdvancePlant p, AdvanceTable t, Py_ssize_t d, Inputs u, Py_ssize_t k, double[::1] x, AdvanceWork work) noexcept nogil
cdef inline void ramp_up(AdvancePlant p, AdvanceTable t, Py_ssize_t d, Inputs u, Py_ssize_t k, double[::1] x) noexcept nogil
cdef void advance_columns(PlantArrays p, StepTable t, Py_ssize_t d, double[:, ::1] B, double[:, ::1] X) noexcept nogil
@cython.locals(X=double[:, ::1], rate_1_s=double, drawn=double, half_s=double)
cdef void couple_half(AdvancePlant p, Inputs u, Py_ssize_t k, double[::1] z, double[::1] x, Py_ssize_t half, AdvanceWork work) noexcept nogil
@cython.locals(X=double[:, ::1], made_of=double[::1], rate_1_s=double, drawn=double, same=bint)
cdef void form_half(PlantArrays p, Inputs u, Py_ssize_t k, double[::1] z, double[:, ::1] B, double[::1] x, Work work) noexcept nogil
@cython.locals(MT=double[:, ::1], moved=double[::1])
cdef void step_half(PlantArrays p, Inputs u, Py_ssize_t k, double[::1] z, double[::1] x, Py_ssize_t half, Work work) noexcept nogil
cdef inline void couple_covariance(PlantArrays p, Inputs u, Py_ssize_t k, double[::1] z, Py_ssize_t half, double[:, ::1] P, Work work) noexcept nogil
cdef void couple_columns(PlantArrays p, Inputs u, Py_ssize_t k, double[::1] z, double[::1] x, double[:, ::1] X, Work work) noexcept nogil
@cython.locals(first=Py_ssize_t, count=Py_ssize_t, weight=double)
cdef void multiply_columns(double[:, ::1] M, Py_ssize_t n_x, double[:, ::1] X, double[:, ::1] scratch) noexcept nogil
@cython.locals(dt_known=double, driven=bint)
cdef void march_steps(OpenLoopMarch loop, double[::1] x, double[:, ::1] states, Py_ssize_t first) noexcept nogil
cdef inline bint is_held(AdvancePlant p, Inputs u, Py_ssize_t k) noexcept nogil
cdef inline void hold_inputs(AdvancePlant p, AdvanceTable t, Inputs u, Py_ssize_t k, double[:, ::1] B, AdvanceWork work) noexcept nogil
cpdef march(OpenLoopMarch loop, double[::1] x, double[:, ::1] states, Py_ssize_t first)
