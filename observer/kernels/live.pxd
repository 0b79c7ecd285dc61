@cython.locals(rows=Rows, row=Py_ssize_t, taken=Py_ssize_t)
cpdef Py_ssize_t put_reading(LiveWalk own, double time_s, double late_s, values) except -2
cpdef void walk_on(Rows rows, Py_ssize_t count, Expected plan, Memory memory, Frames frames) noexcept nogil
@cython.locals(rows=Rows, count=Py_ssize_t)
cpdef tick_on(LiveWalk own, double time_s)
cpdef void drive_on(ColumnsRead read, DriveDesk desk, double begin_s, double last_s) noexcept nogil
cpdef void average_on(NutTable nut, NutDesk desk, const double[::1] dt_s, const double[::1] sample_s, const double[::1] sample_m, const Py_ssize_t[::1] offset, const double[::1] driven_m_s) noexcept nogil
@cython.locals(heat_W=double)
cdef void put_products(Products laws, const double[:, ::1] values, double[:, ::1] law) noexcept nogil
@cython.locals(desk=DriveDesk, inputs=Inputs, moment=double[::1], nut=LiveNut)
cdef drive_frame(DriveTick own)
@cython.locals(path=PathSamples)
cdef watch_frame(TestTick own)
@cython.locals(length_s=double)
cdef estimate_frame(EstimatorTick own)
@cython.locals(drive=DriveTick, estimator=EstimatorTick, test=TestTick)
cpdef step_frame(LiveStep own, bytes data)
