cdef Py_ssize_t STEP, KEY, TAKEN
cdef double _QUIET_JUMP

cdef inline Py_ssize_t find_gain(GainTable gains, Py_ssize_t key) noexcept nogil
cdef inline void copy(double[::1] source, double[::1] target) noexcept nogil
@cython.locals(correcting=bint, alive=Py_ssize_t)
cdef inline (Py_ssize_t, bint) key_of(Inputs u, Py_ssize_t k, Running state, Work work, Py_ssize_t step_bin) noexcept nogil
@cython.locals(jumps=bint, jump_W2=double)
cdef inline bint law_jumps(PlantArrays p, Inputs u, Py_ssize_t k, double[:, ::1] P) noexcept nogil
@cython.locals(key=Py_ssize_t, sensors=Py_ssize_t, moved=bint, correcting=bint, is_valid=bint, released=bint)
cdef void observe(Batch b, Running state, Results out, FixedGainWork gain_work) noexcept nogil
cpdef run_fixed_gain(Batch b, Running state, Results out, FixedGainWork gain_work)
