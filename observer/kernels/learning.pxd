cdef double FOLLOWS_S, _SURE

cdef void follow(PlantArrays p, Batch b, Py_ssize_t k, double[::1] linearisation_point, double[::1] x, Work work) noexcept nogil
cdef void bring(PlantArrays p, double[:, ::1] B, double[::1] before, Work work) noexcept nogil
cdef void multiply(double[:, ::1] VT, double[::1] x, double[::1] y) noexcept nogil
@cython.locals(tied=double, heat_W=double, c=double[::1])
cdef void drive(PlantArrays p, Inputs u, Py_ssize_t k, double[:, ::1] B, Py_ssize_t i, double[::1] x, Work work) noexcept nogil
@cython.locals(apart_K=double, heat_W=double, all_W_K=double, part=double, seen=double, source=Py_ssize_t, i=Py_ssize_t, c=double[::1])
cdef void pass_heat(PlantArrays p, Inputs u, Py_ssize_t k, double[:, ::1] B, Py_ssize_t q, double[::1] x, Work work) noexcept nogil
@cython.locals(entry=double, lag_s=double, slow=Py_ssize_t)
cdef void see(PlantArrays p, Inputs u, Py_ssize_t k, double dt_s, double[:, ::1] C, double[::1] linearisation_point) noexcept nogil
@cython.locals(degC=double)
cdef inline double below(PlantArrays p, Inputs u, Py_ssize_t k, double[:, ::1] C, Py_ssize_t i, double[::1] linearisation_point) noexcept nogil
cdef inline void advance_learning(PlantArrays p, Batch b, Py_ssize_t k, double[::1] x, Py_ssize_t learnt, Work work) noexcept nogil
cdef inline void add_columns_of(double[:, ::1] G, Py_ssize_t first, Py_ssize_t count, Py_ssize_t n_x, double[::1] x) noexcept nogil
cdef inline void keep(PlantArrays p, double[::1] x, double[:, ::1] P, double[:, ::1] saved) noexcept nogil
cdef inline void give_back(PlantArrays p, double[::1] x, double[:, ::1] P, double[:, ::1] saved) noexcept nogil
cdef inline void draw_near(PlantArrays p, double dt_s, double[::1] x, double[::1] linearisation_point) noexcept nogil
cdef void linearise_at(PlantArrays p, Inputs u, Py_ssize_t k, double[:, ::1] C, double[::1] x, double[::1] linearisation_point) noexcept nogil
cdef void begin(PlantArrays p, Inputs u, Py_ssize_t k, Running state, Work work) noexcept nogil
@cython.locals(ambient_K=double, quiet=bint, part=double)
cdef inline bint is_at_rest(PlantArrays p, Inputs u, Py_ssize_t k, unsigned char[::1] usable, double[:, ::1] C) noexcept nogil
cdef inline void rest(PlantArrays p, Inputs u, Py_ssize_t k, double[::1] x, double[:, ::1] P) noexcept nogil
cdef void report_learned(PlantArrays p, double[::1] x, double[:, ::1] P, Py_ssize_t k, Work work, Results out) noexcept nogil
