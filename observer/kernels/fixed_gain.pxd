cdef Py_ssize_t _PREDICTED, _STARTED

cdef inline Py_ssize_t find_gain(GainTable gains, Py_ssize_t key) noexcept nogil
@cython.locals(same=bint)
cdef inline Py_ssize_t find_settled(GainTable gains, double[:, ::1] P) noexcept nogil
cdef inline bint near(double[:, ::1] P, GainTable gains, Py_ssize_t i) noexcept nogil
cdef inline void copy(double[::1] source, double[::1] target) noexcept nogil
cdef inline void put(double[:, ::1] source, double[:, ::1] target) noexcept nogil
@cython.locals(rest=double)
cdef inline void correct_covariance(double[::1] R_K2, double[:, ::1] C, unsigned char[::1] accepted, double[:, ::1] K, double[:, ::1] g, double[:, ::1] P, double[:, ::1] A) noexcept nogil
@cython.locals(complete=bint, alive=Py_ssize_t)
cdef inline (Py_ssize_t, bint) key_of(Inputs u, Py_ssize_t k, unsigned char[::1] usable, unsigned char[::1] accepted, double[::1] suspect, Py_ssize_t step_bin) noexcept nogil
cdef inline void correct_state(double[:, :, ::1] K, Py_ssize_t chosen, unsigned char[::1] accepted, double[::1] nu, double[::1] x) noexcept nogil
@cython.locals(key=Py_ssize_t, complete=bint, started=bint, correcting=bint, steady=bint, known=bint, released=bint, share=double, drastic=bint, roughly=bint)
cdef (Py_ssize_t, Py_ssize_t, Py_ssize_t) observe(PlantArrays p, StepTable t, StepBins bins, Inputs u, Py_ssize_t[::1] step, Running state, double gate_sigma, bint optimal, GainTable gains, Results out, Py_ssize_t first, Py_ssize_t resumed, Work work, SteadyStep c, Considered considered) noexcept nogil
@cython.locals(done=(Py_ssize_t, Py_ssize_t, Py_ssize_t))
cpdef run_fixed_gain(PlantArrays p, StepTable t, StepBins bins, Inputs u, Py_ssize_t[::1] step, Running state, double gate_sigma, bint optimal, GainTable gains, Results out, Py_ssize_t first, Py_ssize_t resumed, Work work, SteadyStep c, Considered considered)
