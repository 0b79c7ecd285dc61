cpdef run_tolerances(Considered a, StepTable t, Inputs u, Py_ssize_t[::1] step, double[::1] x, bint begins, double[:, :, ::1] D, double[:, ::1] expected)
cpdef run_changes_forward(PlantArrays p, StepTable t, Inputs u, Py_ssize_t[::1] step, Tape tape, Work work, double[:, ::1] X, double[:, :, ::1] moved, double[:, :, ::1] heat)
cpdef run_changes_backward(PlantArrays p, StepTable t, Inputs u, Py_ssize_t[::1] step, Tape tape, Work work, double[:, ::1] R, double[:, :, ::1] moved, double[:, :, ::1] heat, double[:, :, ::1] D, double[:, ::1] information)
cdef void tolerances_forward(Considered a, StepTable t, Inputs u, Py_ssize_t[::1] step, double[::1] x, bint begins, double[:, :, ::1] D, double[:, ::1] expected) noexcept nogil
cdef void changes_forward(PlantArrays p, StepTable t, Inputs u, Py_ssize_t[::1] step, Tape tape, Work work, double[:, ::1] X, double[:, :, ::1] moved, double[:, :, ::1] heat) noexcept nogil
cdef void changes_backward(PlantArrays p, StepTable t, Inputs u, Py_ssize_t[::1] step, Tape tape, Work work, double[:, ::1] R, double[:, :, ::1] moved, double[:, :, ::1] heat, double[:, :, ::1] D, double[:, ::1] information) noexcept nogil
cdef void step_changes_back(PlantArrays p, StepTable t, Py_ssize_t d, double[:, ::1] B, double[:, ::1] R) noexcept nogil
cdef void couple_changes_back(PlantArrays p, Inputs u, Py_ssize_t k, double[::1] z, double[::1] x, double[:, ::1] R, Work work) noexcept nogil
