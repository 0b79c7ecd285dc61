cdef void couple(Coupling c, double rate_1_s, double drawn, double[:, ::1] B, double half_s, CoupledColumns columns, double[:, ::1] link) noexcept nogil
@cython.locals(mean_degC=double, square=double, rate=double, drawn=double, lost=double, rise_K=double, variance_K2=double, size_K=double, tangent_1_s=double)
cdef inline (double, double) uniform_loss(Coupling c, double loss_1_s, double loss_degC, double ambient_degC, double[::1] x) noexcept nogil
@cython.locals(total=double, row=double)
cdef double _product(Coupling c, double[::1] x, double[::1] y) noexcept nogil
@cython.locals(keep=double, lost=double)
cdef inline void _lose(Coupling c, double rate_1_s, double drawn, double time_s, CoupledColumns columns, double[::1] gain) noexcept nogil
cdef void _warm(Coupling c, double by_K, CoupledColumns columns) noexcept nogil
@cython.locals(compliance=double)
cdef void _link(Coupling c, Py_ssize_t i, double[:, ::1] B, double time_s, CoupledColumns columns, double[:, ::1] link) noexcept nogil
cdef void see_under(Coupling c, Py_ssize_t source, double[:, ::1] B, double[:, ::1] link) noexcept nogil
@cython.locals(share=double)
cdef inline void _fade_shapes(Coupling c, double[:, ::1] B, double time_s, double[::1] gain) noexcept nogil
@cython.locals(now=double, nut=double, size=double)
cdef double swept_share(Coupling c, Py_ssize_t j, double[:, ::1] B) noexcept nogil
cdef void _spread(Coupling c, Py_ssize_t j, CoupledColumns columns, double[::1] gain) noexcept nogil
cdef void _read_columns(double[:, ::1] rows, Py_ssize_t first, Py_ssize_t count, CoupledColumns columns) noexcept nogil
@cython.locals(sums=double[:, ::1], w0=double, w1=double, w2=double, w3=double)
cdef void _add_factors(double[:, ::1] into, Py_ssize_t first, Py_ssize_t count, double[::1] gain, CoupledColumns columns) noexcept nogil
@cython.locals(part=double, rate_1_s=double, size=double)
cdef inline void swept(Coupling c, Py_ssize_t source, double[:, ::1] shapes, double time_s, double[::1] x, Py_ssize_t order) noexcept nogil
@cython.locals(seen_degC=double)
cdef inline double faded(Coupling c, Py_ssize_t j, double[::1] z, double[:, ::1] B, double[::1] x) noexcept nogil
