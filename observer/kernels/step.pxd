cdef double _DRASTIC

cdef inline void predict(Batch b, Py_ssize_t k, Running state, Work work) noexcept nogil
cdef inline void predict_covariance(PlantArrays p, StepTable t, Py_ssize_t d, Inputs u, Py_ssize_t k, Running state, Work work) noexcept nogil
cdef inline void add_walk(double[:, ::1] B, Py_ssize_t index, StepTable t, Py_ssize_t d, Py_ssize_t j, double[:, ::1] P) noexcept nogil
cdef inline void symmetrise(double[:, ::1] P) noexcept nogil
@cython.locals(nu=double)
cdef inline double residual(PlantArrays p, double[:, ::1] C, Inputs u, Py_ssize_t k, Py_ssize_t i, double[::1] x) noexcept nogil
cdef inline void sensor_covariance(double[:, ::1] C, Py_ssize_t i, double[:, ::1] P, double[:, ::1] g) noexcept nogil
cdef inline void add_rows(double[:, ::1] C, Py_ssize_t i, Py_ssize_t first, Py_ssize_t end, double[:, ::1] P, double[:, ::1] g) noexcept nogil
@cython.locals(total=double)
cdef inline double project(double[:, ::1] C, Py_ssize_t i, double[:, ::1] g, Py_ssize_t j) noexcept nogil
@cython.locals(response=double, level=double, count=Py_ssize_t, place=Py_ssize_t)
cdef void start(PlantArrays p, Inputs u, Py_ssize_t k, Running state, Work work) noexcept nogil
cdef inline bint is_drastic(PlantArrays p, Work work) noexcept nogil
@cython.locals(squares=double, volume=double, shared=double, variance=double, rest=double)
cdef inline double correct_lower(PlantArrays p, Running state, Work work) noexcept nogil
cdef inline void joseph_covariance(Py_ssize_t i, double r, double[:, ::1] P, Work work) noexcept nogil
@cython.locals(squares=double, volume=double)
cdef double correct_in_turn(PlantArrays p, Running state, Work work) noexcept nogil
@cython.locals(rest=double)
cdef void correct_by_gain(PlantArrays p, double[:, ::1] K, Running state, Work work) noexcept nogil
@cython.locals(nu=double, c=double)
cdef inline void compare(PlantArrays p, Inputs u, Py_ssize_t k, Running state, Work work) noexcept nogil
