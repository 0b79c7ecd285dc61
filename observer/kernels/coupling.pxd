cdef void coupled(Coupling c, double loss_1_s, double loss_degC, double[::1] z, double[:, ::1] B, double half_s, double[::1] x, double[:, ::1] M, double[::1] b) noexcept nogil
@cython.locals(rate_1_s=double, drawn=double)
cdef void couple(Coupling c, double loss_1_s, double loss_degC, double[::1] z, double[:, ::1] B, double half_s, double[::1] x, double[:, ::1] M, double[::1] b) noexcept nogil
@cython.locals(mean_degC=double, square=double, rate=double, drawn=double)
cdef inline (double, double) _uniform_loss(Coupling c, double loss_1_s, double loss_degC, double[::1] z, double[::1] x) noexcept nogil
cdef inline void _lose(Coupling c, double rate_1_s, double drawn, double time_s, double[:, ::1] M, double[::1] b) noexcept nogil
@cython.locals(change=double, drive=double)
cdef inline void _film(Coupling c, Py_ssize_t f, double[::1] z, double time_s, double[:, ::1] M, double[::1] b) noexcept nogil
@cython.locals(warm=double)
cdef inline void _fade(double[::1] shape, double lost, double[:, ::1] M) noexcept nogil
@cython.locals(heat_J_K=double, compliance=double, apart_K=double)
cdef inline void _link(Coupling c, Py_ssize_t i, double[::1] z, double[:, ::1] B, double time_s, double[:, ::1] M, double[::1] b) noexcept nogil
cdef inline double _apart(Coupling c, Py_ssize_t i, double[:, ::1] B, Py_ssize_t a) noexcept nogil
cdef inline double _passed(Coupling c, Py_ssize_t i, double[:, ::1] B, Py_ssize_t a) noexcept nogil
@cython.locals(now=double, nut=double, lost=double, size=double, warm=double)
cdef inline void _spread(Coupling c, Py_ssize_t i, double[:, ::1] B, double time_s, double[:, ::1] M, double[::1] b) noexcept nogil
@cython.locals(part=double, rate_1_s=double, size=double, warm=double)
cdef inline void swept(Coupling c, Py_ssize_t source, double[:, ::1] shapes, double time_s, double[::1] x, Py_ssize_t order) noexcept nogil
@cython.locals(below=double)
cdef inline void _sensor(Coupling c, Py_ssize_t i, double[::1] z, double time_s, double[:, ::1] M, double[::1] b) noexcept nogil
cdef inline double under(Coupling c, Py_ssize_t source, double[:, ::1] B, Py_ssize_t a) noexcept nogil
@cython.locals(seen_degC=double)
cdef inline double faded(Coupling c, Py_ssize_t j, double[::1] z, double[:, ::1] B, double[::1] x) noexcept nogil
