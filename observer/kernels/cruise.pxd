cdef double _QUIET_JUMP

cdef void lay_out(PlantArrays p, StepTable t, Py_ssize_t d, double[:, ::1] B, double[:, ::1] C, double[:, ::1] K, double[::1] S, Columns c) noexcept nogil
cdef inline bint begin_cruise(PlantArrays p, GainTable gains, Py_ssize_t settled, Running state, Columns c) noexcept nogil
@cython.locals(good=bint, jump=double)
cdef inline bint is_regular(PlantArrays p, Inputs u, Py_ssize_t k, unsigned char[::1] usable, Columns c) noexcept nogil
cdef inline bint step_state(PlantArrays p, Inputs u, Py_ssize_t k, unsigned char[::1] usable, Columns c) noexcept nogil
@cython.locals(total=double, law=double)
cdef inline bint write_steady(PlantArrays p, Inputs u, Py_ssize_t k, unsigned char[::1] usable, GainTable gains, Py_ssize_t settled, Columns c, Work work, Results out) noexcept nogil
@cython.locals(known=bint, roughly=bint, exact=bint)
cdef Py_ssize_t cruise(PlantArrays p, StepTable t, Rungs rungs, Inputs u, Py_ssize_t[::1] step, Running state, double gate_sigma, GainTable gains, Py_ssize_t settled, Results out, Py_ssize_t k, Work work, Columns c, Allowed allowed) noexcept nogil
