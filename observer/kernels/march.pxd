@cython.locals(dt_known=double, driven=bint)
cdef void march_steps(AdvancePlant p, AdvanceTable t, double[::1] decay, Inputs u, double[:, ::1] B, double[:, ::1] C, AdvanceWork work, double[::1] x, double[:, ::1] states, Py_ssize_t first) noexcept nogil
cdef inline bint is_held(AdvancePlant p, Inputs u, Py_ssize_t k) noexcept nogil
cdef inline void hold_inputs(AdvancePlant p, AdvanceTable t, Inputs u, Py_ssize_t k, double[:, ::1] B, AdvanceWork work) noexcept nogil
