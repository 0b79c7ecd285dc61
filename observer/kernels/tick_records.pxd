cdef class Products(Record):
    cdef public Py_ssize_t[::1] base
    cdef public Py_ssize_t[::1] column
    cdef public double[:, ::1] factors


cdef class PathSamples(Record):
    cdef public double[::1] time_s
    cdef public double[::1] position_m
    cdef public Py_ssize_t[::1] offset
    cdef public double[::1] driven_m_s


cdef class LiveNut(Record):
    cdef public NutTable table
    cdef public NutDesk desk
    cdef public PathSamples path


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
    cdef public Products laws
    cdef public DriveDesk desk
    cdef public double[::1] dt_s
    cdef public double[::1] moment
    cdef public tuple nuts
    cdef public Inputs inputs
    cdef public object before
    cdef public object after


cdef class EstimatorTick(Record):
    cdef public Inputs inputs
    cdef public double length_s
    cdef public object table_of
    cdef public StepTable table
    cdef public Py_ssize_t[::1] step
    cdef public PlantArrays plant
    cdef public Running running
    cdef public double gate_sigma
    cdef public Results results
    cdef public Work work
    cdef public object other
    cdef public object finish
    cdef public double[::1] time_s
    cdef public unsigned char[::1] octets
    cdef public Gathered gathered
    cdef public Held held
    cdef public double sigmas
    cdef public object step_bank


cdef class TestTick(Record):
    cdef public tuple paths
    cdef public double[::1] strokes_m
    cdef public SelfTestState state
    cdef public Inputs inputs
    cdef public Tested seen
    cdef public Trust trust
    cdef public double[::1] scores


cdef class LiveStep(Record):
    cdef public DriveTick drive
    cdef public EstimatorTick estimator
    cdef public TestTick test


cdef class Message(Record):
    cdef public unsigned char[::1] out
    cdef public unsigned char[::1] pieces
    cdef public Py_ssize_t[::1] ends
    cdef public Py_ssize_t[::1] begin
    cdef public Py_ssize_t[::1] numbers
    cdef public Py_ssize_t qualities
    cdef public Py_ssize_t sensors
    cdef public Py_ssize_t time_at
    cdef public Py_ssize_t quality_at
    cdef public Py_ssize_t sensors_at
