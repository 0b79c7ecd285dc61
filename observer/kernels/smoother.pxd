cdef void filter_with_tape(Batch b, Running state, Work work, Tape tape) noexcept nogil
@cython.locals(one_by_one=bint)
cdef void write_tape(PlantArrays p, Py_ssize_t k, Running state, Work work, Tape tape) noexcept nogil
cdef void smooth_back(Batch b, Tape tape, Adjoint adjoint, Work work, Smoothed out) noexcept nogil
@cython.locals(total=double)
cdef inline double dot(double[:, :, ::1] rows, Py_ssize_t k, Py_ssize_t i, double[::1] r) noexcept nogil
@cython.locals(total=double)
cdef inline double quadratic(double[:, :, ::1] rows, Py_ssize_t k, Py_ssize_t i, double[:, ::1] N, double[::1] NK) noexcept nogil
cdef void write_jumps(PlantArrays p, Inputs u, Py_ssize_t k, double[::1] r, double[:, ::1] N, Smoothed out) noexcept nogil
cdef inline void correct_back(PlantArrays p, double[:, ::1] C, Py_ssize_t i, Py_ssize_t k, Tape tape, Adjoint adjoint, Smoothed out) noexcept nogil
@cython.locals(total=double)
cdef inline void step_back(PlantArrays p, StepTable t, Py_ssize_t d, double[:, ::1] B, double[::1] r, double[:, ::1] N, Work work) noexcept nogil
@cython.locals(M=double[:, ::1], MT=double[:, ::1], moved=double[::1])
cdef void couple_back(PlantArrays p, Inputs u, Py_ssize_t k, double[::1] z, double[::1] x, Adjoint adjoint, Work work) noexcept nogil
cpdef run_forward(Batch b, Running state, Work work, Tape tape)
cpdef run_backward(Batch b, Tape tape, Adjoint adjoint, Work work, Smoothed out)
