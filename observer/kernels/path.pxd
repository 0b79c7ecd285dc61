cdef double MEMORY_S, SAMPLES_PER_TRAVERSE, FORGOTTEN_S, FULL, FINE, TURNED, BRIEF_S, BELIEVED
cdef Py_ssize_t RECENT, RANK

@cython.locals(nut="PathMemory*")
cpdef void follow_path(PathMemory[::1] memory, NutPath path, double stroke_m, double[:, ::1] ends_m) noexcept nogil
@cython.locals(since_s=double, here_m=double, before=double, turn_m=double, made_m_s=double, lately_m_s=double, speed_m_s=double, run_m=double, sense=double, has_speed=bint, resolved=bint)
cdef double take_sample(PathMemory *nut, double at_s, double there_m, double driven_m_s, double stroke_m) noexcept nogil
cdef double _mean_driven(double first_m_s, double last_m_s) noexcept nogil
@cython.locals(count=Py_ssize_t, rank=Py_ssize_t, faster=Py_ssize_t, as_fast=Py_ssize_t, speed_m_s=double)
cdef double _remember(PathMemory *nut, double made_m_s, double since_s) noexcept nogil
@cython.locals(here_m=double, before=double, speed_m_s=double, made_m=double, full=bint, fine=bint)
cdef double _turn(PathMemory *nut, double there_m, double run_m, double stroke_m) noexcept nogil
@cython.locals(back_m=double, onward=bint)
cdef void _come(PathMemory *nut, double place_m, double stroke_m) noexcept nogil
@cython.locals(length_m=double, along=double, back=bint, turned=bint)
cdef (double, double) on_the_way(double here_m, double run_m, double low_m, double high_m) noexcept nogil

@cython.locals(memory="PathMemory*", weight=double, gap_s=double, located=bint, here_m=double, there_m=double, since_s=double, before=double, low_m=double, high_m=double, turn_m=double, runs_on=bint, run_m=double, share=double, out_m=double, back_m=double, length_m=double, points=Py_ssize_t, part=double, centre=double, _=double, fade=double, settle=double, spread=bint, column=double)
cpdef void average_columns(NutTable nut, NutDesk desk, const double[::1] dt_s, NutPath path) noexcept nogil
@cython.locals(centre=double, a=double, b=double, middle=double, half=double, reach=double, mean=double, place=double, low=Py_ssize_t, right=double)
cpdef void add_columns(double[::1] B, double[::1] C, double share, double centre_m, NutTable nut) noexcept nogil
@cython.locals(G=Py_ssize_t, cos_x=double, sin_x=double, cos_half=double, sin_half=double, c=double, s=double, h=double, r=double, reach=double, mean=double)
cdef void add_waves(double[::1] B, double share, double x, double half, const double[::1] mu) noexcept nogil
cdef inline double sign(double value) noexcept nogil
@cython.locals(left=double)
cdef inline double remainder(double value, double period) noexcept nogil
