cdef class LiveNut(Record):
    cdef public NutTable table
    cdef public NutDesk desk
    cdef public NutPath path


cdef class LiveWalk(Record):
    cdef public tuple names
    cdef public Rows rows
    cdef public Py_ssize_t waiting
    cdef public Expected plan
    cdef public Memory memory
    cdef public Frames frames
    cdef public unsigned char[::1] octets


cdef class DriveTick(Record):
    cdef public unsigned char[::1] octets
    cdef public ColumnsRead read
    cdef public DriveDesk desk
    cdef public double[::1] dt_s, moment
    cdef public tuple nuts
    cdef public Inputs inputs
    cdef public object before, after


cdef class EstimatorTick(Record):
    cdef public Batch batch
    cdef public double length_s
    cdef public object table_of, other, finish, step_bank
    cdef public Running running
    cdef public Results results
    cdef public Work work
    cdef public double[::1] time_s
    cdef public unsigned char[::1] octets
    cdef public Gathered gathered
    cdef public BankBounds bounds


cdef class TestTick(Record):
    cdef public tuple paths
    cdef public double[:, ::1] travel_m
    cdef public double[::1] scores
    cdef public SelfTestState state
    cdef public Inputs inputs
    cdef public Tested tested
    cdef public Trust trust


cdef class LiveStep(Record):
    cdef public DriveTick drive
    cdef public EstimatorTick estimator
    cdef public TestTick test


cdef class Message(Record):
    cdef public unsigned char[::1] out, pieces
    cdef public Py_ssize_t[::1] ends, begin, numbers
    cdef public Py_ssize_t qualities, sensors, time_at, quality_at, parts_at, sensors_at
