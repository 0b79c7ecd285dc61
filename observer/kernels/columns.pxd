cdef void lay_out(PlantArrays p, StepTable t, Py_ssize_t d, double[:, ::1] B, double[:, ::1] C, double[:, ::1] K, Columns c) noexcept nogil
cdef void lay_out_moving(PlantArrays p, StepTable t, Py_ssize_t d, double[:, ::1] B, double[:, ::1] C, Columns c) noexcept nogil
@cython.locals(read=double)
cdef inline void lay_out_state(StepTable t, Py_ssize_t d, double[:, ::1] C, Py_ssize_t a, Columns c) noexcept nogil
cdef inline void lay_out_source(PlantArrays p, StepTable t, Py_ssize_t d, double[:, ::1] B, Py_ssize_t j, Columns c) noexcept nogil
cdef void lay_out_readings(PlantArrays p, Py_ssize_t m, Columns c) noexcept nogil
@cython.locals(x0=double, x1=double, x2=double, x3=double, w0=double, w1=double, w2=double, w3=double, w4=double, w5=double, w6=double, w7=double)
cdef inline void see_drive(Columns c, Py_ssize_t w) noexcept nogil
cdef inline void move_reported(PlantArrays p, Inputs u, Py_ssize_t k, double[:, :, ::1] rows) noexcept nogil
