cdef double MEMORY_S, SAMPLES_PER_TRAVERSE, FORGOTTEN_S, FULL, FINE, TURNED, BRIEF_S, BELIEVED
cdef Py_ssize_t RECENT, RANK
cdef Py_ssize_t _AT, _HERE, _VELOCITY, _SPEED, _LOW, _HIGH, _DRIVEN, _SENSE, _FAR, _COUNT, _MADE

cpdef void follow_path(double[::1] scalars, const double[::1] sample_s, const double[::1] sample_m, const Py_ssize_t[::1] offset, const double[::1] driven_m_s, double stroke_m, double[:, ::1] ends_m) noexcept nogil
@cython.locals(since_s=double, here_m=double, before=double, turn_m=double, made_m_s=double, lately_m_s=double, speed_m_s=double, run_m=double, sense=double, known=bint, told=bint)
cdef double take_sample(double[::1] scalars, double at_s, double there_m, double driven_m_s, double stroke_m) noexcept nogil
cdef double _mean_driven(double first_m_s, double last_m_s) noexcept nogil
@cython.locals(known=Py_ssize_t, rank=Py_ssize_t, faster=Py_ssize_t, as_fast=Py_ssize_t, own=double)
cdef double _remember(double[::1] scalars, double made_m_s, double since_s) noexcept nogil
@cython.locals(here_m=double, before=double, speed_m_s=double, made_m=double, full=bint, fine=bint)
cdef double _turn(double[::1] scalars, double there_m, double run_m, double stroke_m) noexcept nogil
@cython.locals(back_m=double, onward=bint)
cdef void _come(double[::1] scalars, double place_m, double stroke_m) noexcept nogil
@cython.locals(length_m=double, along=double, back=bint, turned=bint)
cdef (double, double) on_the_way(double here_m, double run_m, double low_m, double high_m) noexcept nogil
