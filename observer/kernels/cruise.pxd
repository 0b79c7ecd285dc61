cdef double _QUIET_JUMP

cdef inline bint begin_cruise(PlantArrays p, GainTable gains, Py_ssize_t settled, Running state, Columns c) noexcept nogil
cdef inline Py_ssize_t count_regular(PlantArrays p, Inputs u, Py_ssize_t[::1] step, Py_ssize_t k, Py_ssize_t most, Columns c) noexcept nogil
@cython.locals(there=bint)
cdef inline Py_ssize_t read_run(Inputs u, Py_ssize_t k, Py_ssize_t count, Columns c) noexcept nogil
cdef inline void force_step(Columns c, Py_ssize_t r) noexcept nogil
@cython.locals(nu=lanes)
cdef inline void innovate(Columns c, Py_ssize_t r) noexcept nogil
@cython.locals(x=lanes)
cdef inline void push_states(Columns c, Py_ssize_t r, Py_ssize_t first) noexcept nogil
cdef inline void report_rows(Columns c, Py_ssize_t r) noexcept nogil
cdef void step_states(Columns c, Py_ssize_t count, Py_ssize_t first) noexcept nogil
cdef inline bint is_driven_alike(Columns c, Py_ssize_t r) noexcept nogil
cdef inline Py_ssize_t count_passed(Columns c, Py_ssize_t count) noexcept nogil
@cython.locals(law=double, heat=double, sigma=double, whole=bint, there=bint)
cdef void write_run(PlantArrays p, Inputs u, Py_ssize_t k, Py_ssize_t count, GainTable gains, Py_ssize_t settled, Columns c, Results out) noexcept nogil
cdef inline void write_qualities(signed char[:, ::1] given, signed char[::1] degraded, Py_ssize_t k, Py_ssize_t count, bint whole, signed char[:, ::1] sensor_quality, signed char[::1] quality) noexcept nogil
cdef inline bint is_known(Results out, Py_ssize_t k) noexcept nogil
cdef inline void go_on(PlantArrays p, Columns c, Py_ssize_t r, Running state) noexcept nogil
@cython.locals(roughly=bint, moving=bint)
cdef Py_ssize_t cruise(PlantArrays p, StepTable t, Rungs rungs, Inputs u, Py_ssize_t[::1] step, Running state, double gate_sigma, GainTable gains, Py_ssize_t settled, Results out, Py_ssize_t k, Work work, Columns c, Allowed allowed) noexcept nogil
