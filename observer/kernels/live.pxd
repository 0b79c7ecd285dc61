@cython.locals(rows=Rows, row=Py_ssize_t, taken=Py_ssize_t)
cpdef Py_ssize_t put_reading(LiveWalk walk, double time_s, double late_s, values) except -2
@cython.locals(rows=Rows, count=Py_ssize_t)
cpdef tick_on(LiveWalk walk, double time_s)
@cython.locals(hours=double, hours_before=double, ready=bint, column=Py_ssize_t)
cpdef void fill_inputs(ColumnsRead read, DriveDesk desk, double begin_s, double last_s) noexcept nogil
@cython.locals(ready=bint, before=double, start=double)
cdef inline bint _fill_known(ColumnsRead read, DriveDesk desk, Py_ssize_t k, double hours, double hours_before) noexcept nogil
@cython.locals(before=double)
cdef inline void _fill_laws(DriveDesk desk, Py_ssize_t k) noexcept nogil
@cython.locals(desk=DriveDesk, inputs=Inputs, moment=double[::1], nut=LiveNut)
cdef drive_frame(DriveTick tick)
cdef watch_frame(TestTick tick)
@cython.locals(length_s=double)
cdef estimate_frame(EstimatorTick tick)
@cython.locals(drive=DriveTick, estimator=EstimatorTick, test=TestTick)
cpdef step_frame(LiveStep step, bytes data)
