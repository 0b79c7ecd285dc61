cpdef run_changes_forward(PlantArrays p, StepTable t, Inputs u, Py_ssize_t[::1] step, Tape tape, Work work, double[:, ::1] X, double[:, :, ::1] told, double[:, :, ::1] heat)
cpdef run_changes_backward(PlantArrays p, StepTable t, Inputs u, Py_ssize_t[::1] step, Tape tape, Work work, double[:, ::1] R, double[:, :, ::1] told, double[:, :, ::1] heat)
cdef void changes_forward(PlantArrays p, StepTable t, Inputs u, Py_ssize_t[::1] step, Tape tape, Work work, double[:, ::1] X, double[:, :, ::1] told, double[:, :, ::1] heat) noexcept nogil
cdef void step_changes(PlantArrays p, StepTable t, Py_ssize_t d, double[:, ::1] B, double[:, ::1] X) noexcept nogil
cdef void couple_changes(PlantArrays p, Inputs u, Py_ssize_t k, double[::1] z, double[::1] x, double[:, ::1] X, Work work) noexcept nogil
cdef void changes_backward(PlantArrays p, StepTable t, Inputs u, Py_ssize_t[::1] step, Tape tape, Work work, double[:, ::1] R, double[:, :, ::1] told, double[:, :, ::1] heat) noexcept nogil
cdef void couple_changes_back(PlantArrays p, Inputs u, Py_ssize_t k, double[::1] z, double[::1] x, double[:, ::1] R, Work work) noexcept nogil
cdef void add_row(double[::1] target, double weight, double[::1] row) noexcept nogil
