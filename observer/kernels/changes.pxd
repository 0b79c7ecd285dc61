cpdef run_tolerances(Sensitivities a, Batch b, double[::1] x, bint begins, double[:, :, ::1] D, double[:, ::1] expected)
cpdef run_changes_forward(Batch b, Tape tape, Work work, double[:, ::1] X, Changed changed)
cpdef run_changes_backward(Batch b, Tape tape, Work work, double[:, ::1] R, Changed changed, double[:, :, ::1] D, double[:, ::1] information)
cdef void tolerances_forward(Sensitivities a, Batch b, double[::1] x, bint begins, double[:, :, ::1] D, double[:, ::1] expected) noexcept nogil
cdef void carry_sensitivities(Sensitivities a, Batch b, Py_ssize_t k) noexcept nogil
@cython.locals(total=double)
cdef inline double sensed(Sensitivities a, Py_ssize_t i, Py_ssize_t q) noexcept nogil
cdef void changes_forward(Batch b, Tape tape, Work work, double[:, ::1] X, Changed changed) noexcept nogil
cdef void changes_backward(Batch b, Tape tape, Work work, double[:, ::1] R, Changed changed, double[:, :, ::1] D, double[:, ::1] information) noexcept nogil
cdef void step_changes_back(PlantArrays p, StepTable t, Py_ssize_t d, double[:, ::1] B, double[:, ::1] R) noexcept nogil
cdef void couple_changes_back(PlantArrays p, Inputs u, Py_ssize_t k, double[::1] z, double[::1] x, double[:, ::1] R, Work work) noexcept nogil
