cdef void lay_out(PlantArrays p, StepTable t, Py_ssize_t d, double[:, ::1] B, double[:, ::1] C, double[:, ::1] K, Columns c) noexcept nogil
cdef void lay_out_moving(PlantArrays p, StepTable t, Py_ssize_t d, double[:, ::1] B, double[:, ::1] C, Columns c) noexcept nogil
@cython.locals(read=double)
cdef inline void lay_out_state(StepTable t, Py_ssize_t d, double[:, ::1] C, Py_ssize_t a, Columns c) noexcept nogil
cdef inline void lay_out_source(PlantArrays p, StepTable t, Py_ssize_t d, double[:, ::1] B, Py_ssize_t j, Columns c) noexcept nogil
cdef void lay_out_readings(PlantArrays p, Py_ssize_t m, Columns c) noexcept nogil
cdef inline void see_drive(Columns c, Py_ssize_t w) noexcept nogil
cdef inline void move_reported(PlantArrays p, Inputs u, Py_ssize_t k, double[:, ::1] rows) noexcept nogil
