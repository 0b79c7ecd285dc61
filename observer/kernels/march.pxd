@cython.locals(dt_known=double)
cdef void march_steps(AdvancePlant p, AdvanceTable t, double[::1] decay, Inputs u, double[:, ::1] B, double[:, ::1] C, AdvanceWork work, double[::1] x, double[:, ::1] states) noexcept nogil
