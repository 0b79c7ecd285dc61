@cython.locals(row=lanes)
cdef inline void force_columns(double[:, ::1] P, double[:, ::1] G, Py_ssize_t columns, Py_ssize_t n_x, StepTable t, Py_ssize_t d, Work work) noexcept nogil
@cython.locals(left=lanes, right=lanes, left0=lanes, right0=lanes, left1=lanes, right1=lanes, left2=lanes, right2=lanes, left3=lanes, right3=lanes)
cdef inline void fade_and_force(double[:, ::1] P, double[:, ::1] H, double[:, ::1] G, Py_ssize_t columns, Py_ssize_t n_x, StepTable t, Py_ssize_t d) noexcept nogil
cdef inline void mirror(double[:, ::1] P) noexcept nogil
@cython.locals(rest=lanes)
cdef inline void subtract_seen(double[::1] read, double[:, ::1] C, double[::1] x) noexcept nogil
@cython.locals(left=lanes, right=lanes, left0=lanes, right0=lanes, left1=lanes, right1=lanes, left2=lanes, right2=lanes, left3=lanes, right3=lanes)
cdef inline void multiply_rows(double[:, ::1] A, double[:, ::1] B, Py_ssize_t inner, Py_ssize_t columns, bint lower, double[:, ::1] out) noexcept nogil
cdef void take_along(double[:, ::1] M, double[:, ::1] MT, Py_ssize_t n_x, double[:, ::1] P, double[:, ::1] scratch) noexcept nogil
cdef inline void store_pair(double[:, ::1] A, Py_ssize_t a, Py_ssize_t q, lanes left, lanes right) noexcept nogil
@cython.locals(one=lanes, other=lanes)
cdef inline void innovation_covariances(double[:, ::1] g, double[:, ::1] C, double[:, ::1] S) noexcept nogil
@cython.locals(left=lanes, right=lanes, inverse=double, shared=double)
cdef inline void whiten(double[:, ::1] L, double[:, ::1] g, Py_ssize_t count, Py_ssize_t i, double[:, ::1] W) noexcept nogil
@cython.locals(two=lanes, end=Py_ssize_t, w0=double, w1=double, w2=double, w3=double)
cdef inline void subtract_squares(double[:, ::1] W, Py_ssize_t count, double[:, ::1] P) noexcept nogil
@cython.locals(whole=lanes, half=lanes)
cdef inline void squares_of_rows(double[:, ::1] P, double[:, ::1] rows, Py_ssize_t count, double[::1] total) noexcept nogil
@cython.locals(two=lanes)
cdef inline lanes sum_scaled(lanes total, double[:, ::1] rows, Py_ssize_t q, double[:, ::1] weights, Py_ssize_t w, Py_ssize_t count) noexcept nogil
cdef inline void add_scaled(double[::1] target, double[:, ::1] rows, double[::1] weights, Py_ssize_t count) noexcept nogil
cdef inline void add_row(double[::1] target, double weight, double[::1] row) noexcept nogil
cdef inline double squared(double value) noexcept nogil
