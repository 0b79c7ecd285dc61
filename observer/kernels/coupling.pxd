cdef void coupled(Coupling c, double loss_1_s, double loss_degC, double[::1] z, double[:, ::1] B, double half_s, double[::1] x, double[:, ::1] M, double[::1] b, double[:, ::1] link) noexcept nogil
@cython.locals(rate_1_s=double, drawn=double)
cdef void couple(Coupling c, double loss_1_s, double loss_degC, double[::1] z, double[:, ::1] B, double half_s, double[::1] x, double[:, ::1] M, double[::1] b, double[:, ::1] link) noexcept nogil
@cython.locals(mean_degC=double, square=double, rate=double, drawn=double)
cdef inline (double, double) _uniform_loss(Coupling c, double loss_1_s, double loss_degC, double[::1] z, double[::1] x) noexcept nogil
@cython.locals(total=double, row=double)
cdef double _product(Coupling c, double[::1] x, double[::1] y) noexcept nogil
cdef inline void _lose(Coupling c, double rate_1_s, double drawn, double time_s, double[:, ::1] M, double[::1] b, double[:, ::1] link) noexcept nogil
@cython.locals(lost=double, excess=double)
cdef inline void _lose_unevenly(Coupling c, Py_ssize_t e, double rate_1_s, double drawn, double time_s, double[:, ::1] M, double[::1] b, double[:, ::1] link) noexcept nogil
@cython.locals(held=double)
cdef inline void _give_back(Coupling c, Py_ssize_t i, double more, double[:, ::1] M, double[::1] b, double[:, ::1] link) noexcept nogil
@cython.locals(heat_J_K=double, compliance=double, apart_K=double)
cdef inline void _link(Coupling c, Py_ssize_t i, double[::1] z, double[:, ::1] B, double time_s, double[:, ::1] M, double[::1] b, double[:, ::1] link) noexcept nogil
@cython.locals(row=double)
cdef void see_under(Coupling c, Py_ssize_t source, double[:, ::1] B, double[:, ::1] link) noexcept nogil
@cython.locals(now=double, nut=double, lost=double, size=double, warm=double)
cdef inline void _spread(Coupling c, Py_ssize_t i, double[:, ::1] B, double time_s, double[:, ::1] M, double[::1] b, double[:, ::1] link) noexcept nogil
@cython.locals(weight=double, first=Py_ssize_t, count=Py_ssize_t)
cdef void _pass_on(double[::1] read, double[::1] into, double share, Py_ssize_t n_x, double[:, ::1] M, double[::1] sums) noexcept nogil
@cython.locals(part=double, rate_1_s=double, size=double)
cdef inline void swept(Coupling c, Py_ssize_t source, double[:, ::1] shapes, double time_s, double[::1] x, Py_ssize_t order) noexcept nogil
@cython.locals(seen_degC=double)
cdef inline double faded(Coupling c, Py_ssize_t j, double[::1] z, double[:, ::1] B, double[::1] x) noexcept nogil
