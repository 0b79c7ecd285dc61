cdef void lay_out(PlantArrays p, StepTable t, Py_ssize_t d, double[:, ::1] B, double[:, ::1] C, double[:, ::1] K, SteadyStep c) noexcept nogil
cdef void lay_out_moving(PlantArrays p, StepTable t, Py_ssize_t d, double[:, ::1] B, double[:, ::1] C, SteadyStep c) noexcept nogil
@cython.locals(read=double)
cdef inline void lay_out_state(StepTable t, Py_ssize_t d, double[:, ::1] C, Py_ssize_t a, SteadyStep c) noexcept nogil
cdef inline void lay_out_source(PlantArrays p, StepTable t, Py_ssize_t d, double[:, ::1] B, Py_ssize_t j, SteadyStep c) noexcept nogil
cdef void lay_out_readings(PlantArrays p, Py_ssize_t m, SteadyStep c) noexcept nogil
cdef inline void see_drive(SteadyStep c, Py_ssize_t w) noexcept nogil

cdef double _QUIET_JUMP

cdef inline bint begin_steady_state(PlantArrays p, GainTable gains, Py_ssize_t settled, Running state, SteadyStep c) noexcept nogil
cdef inline Py_ssize_t count_regular(PlantArrays p, Inputs u, Py_ssize_t[::1] step, Py_ssize_t k, Py_ssize_t most, SteadyStep c) noexcept nogil
@cython.locals(there=bint)
cdef inline Py_ssize_t read_run(Inputs u, Py_ssize_t k, Py_ssize_t count, SteadyStep c) noexcept nogil
cdef inline void force_step(SteadyStep c, Py_ssize_t r) noexcept nogil
@cython.locals(nu=lanes)
cdef inline void innovate(SteadyStep c, Py_ssize_t r) noexcept nogil
@cython.locals(x=lanes)
cdef inline void push_states(SteadyStep c, Py_ssize_t r, Py_ssize_t first) noexcept nogil
cdef inline void report_rows(SteadyStep c, Py_ssize_t r) noexcept nogil
cdef void step_states(SteadyStep c, Py_ssize_t count, Py_ssize_t first) noexcept nogil
cdef inline bint is_driven_alike(SteadyStep c, Py_ssize_t r) noexcept nogil
cdef inline void set_gate(double gate_sigma, double[::1] variance_K2, SteadyStep c) noexcept nogil
cdef inline Py_ssize_t count_passed(SteadyStep c, Py_ssize_t count) noexcept nogil
@cython.locals(law=double, heat=double, sigma=double, whole=bint, there=bint)
cdef void write_run(Batch b, Py_ssize_t k, Py_ssize_t count, GainTable gains, Py_ssize_t settled, SteadyStep c, Results out) noexcept nogil
cdef inline void write_qualities(signed char[:, ::1] given, signed char[::1] degraded, Py_ssize_t k, Py_ssize_t count, bint whole, Results out) noexcept nogil
cdef inline bint is_known(Results out, Py_ssize_t k) noexcept nogil
cdef inline void go_on(PlantArrays p, SteadyStep c, Py_ssize_t r, Running state) noexcept nogil
@cython.locals(roughly=bint, moving=bint)
cdef Py_ssize_t take_steady_steps(Batch b, Py_ssize_t settled, Py_ssize_t k, Running state, Results out, FixedGainWork own) noexcept nogil
