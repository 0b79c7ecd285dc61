cdef Py_ssize_t STEP, KEY, TAKEN

cdef inline Py_ssize_t find_gain(GainTable gains, Py_ssize_t key) noexcept nogil
@cython.locals(same=bint)
cdef inline Py_ssize_t find_settled(GainTable gains, double[:, ::1] P) noexcept nogil
cdef inline bint near(double[:, ::1] P, GainTable gains, Py_ssize_t i) noexcept nogil
cdef inline void copy(double[::1] source, double[::1] target) noexcept nogil
cdef inline void put(double[:, ::1] source, double[:, ::1] target) noexcept nogil
@cython.locals(rest=double)
cdef inline void correct_by_gain(PlantArrays p, double[:, ::1] K, Running state, Work work) noexcept nogil
@cython.locals(complete=bint, correcting=bint, alive=Py_ssize_t)
cdef inline (Py_ssize_t, bint, bint) key_of(Inputs u, Py_ssize_t k, Running state, Work work, Py_ssize_t step_bin) noexcept nogil
@cython.locals(key=Py_ssize_t, complete=bint, correcting=bint, steady=bint, known=bint, released=bint, drastic=bint)
cdef void observe(Batch b, Running state, Results out, FixedGainWork own) noexcept nogil
cpdef run_fixed_gain(Batch b, Running state, Results out, FixedGainWork own)
