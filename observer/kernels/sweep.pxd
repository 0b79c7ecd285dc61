cpdef run_sweep(Batch b, Work work, double[:, ::1] X, bint begins, double[:, :, ::1] w, double[:, :, ::1] heat, double[:, :, ::1] rows)
cpdef run_sweep_back(Batch b, Work work, double[:, ::1] R, bint begins, double[:, :, ::1] rows, double[:, :, ::1] w)
cdef void sweep_forward(Batch b, Work work, double[:, ::1] X, bint begins, double[:, :, ::1] w, double[:, :, ::1] heat, double[:, :, ::1] rows) noexcept nogil
cdef void sweep_back(Batch b, Work work, double[:, ::1] R, bint begins, double[:, :, ::1] rows, double[:, :, ::1] w) noexcept nogil
