cdef class Record:
    pass


cdef class Links(Record):
    cdef public Py_ssize_t[::1] source
    cdef public double[::1] conductance_W_K
    cdef public double[:, ::1] C
    cdef public double[:, ::1] B


cdef class Spreads(Record):
    cdef public Py_ssize_t[::1] source
    cdef public double[::1] rate_1_s
    cdef public double[:, ::1] row
    cdef public double[:, ::1] into
    cdef public double[::1] swept
    cdef public double[::1] at_rest


cdef class Fades(Record):
    cdef public double[::1] per_K
    cdef public double[::1] reference_degC


cdef class Coupling(Record):
    cdef public bint active
    cdef public Py_ssize_t ambient
    cdef public Py_ssize_t modes
    cdef public double conductance_W_m
    cdef public double[::1] place_gain
    cdef public double[:, ::1] under_C
    cdef public double[:, ::1] under_F
    cdef public double[::1] uniform
    cdef public double[::1] mean
    cdef public double square
    cdef public double radiation
    cdef public double zero_degC_K
    cdef public double[:, ::1] metric
    cdef public double[:, ::1] beside
    cdef public double[:, ::1] beside_into
    cdef public Links links
    cdef public Spreads spreads
    cdef public Fades fades


cdef class LearningArrays(Record):
    cdef public Py_ssize_t machine
    cdef public Py_ssize_t[::1] kind
    cdef public Py_ssize_t[::1] of
    cdef public double[::1] sigma
    cdef public Py_ssize_t[::1] held
    cdef public double[:, ::1] rate_1_s
    cdef public double[:, ::1] into
    cdef public double[:, ::1] seen
    cdef public double[:, ::1] heats
    cdef public Py_ssize_t[::1] law
    cdef public double[:, :, ::1] known
    cdef public double[:, ::1] steady
    cdef public double[:, ::1] row
    cdef public double[::1] shift_K
    cdef public double[::1] lag_s
    cdef public Py_ssize_t[::1] heated
    cdef public Py_ssize_t ambient
    cdef public Py_ssize_t rests
    cdef public double[:, ::1] rest_P
    cdef public double[:, ::1] V
    cdef public double[:, ::1] inverse


cdef class AdvancePlant(Record):
    cdef public Py_ssize_t modes
    cdef public double[:, ::1] B
    cdef public double[:, ::1] E
    cdef public Py_ssize_t[::1] source
    cdef public Py_ssize_t[::1] moving
    cdef public Coupling coupling


cdef class PlantArrays(AdvancePlant):
    cdef public double[:, ::1] C
    cdef public double[:, ::1] F
    cdef public double[:, ::1] rows
    cdef public double[:, ::1] rows_F
    cdef public double[::1] R_K2
    cdef public double[::1] uniform
    cdef public double[:, ::1] lags
    cdef public double[:, ::1] prior_P
    cdef public double[::1] initial_W2
    cdef public double[::1] law_uncertainty
    cdef public Py_ssize_t[::1] moving_heat
    cdef public LearningArrays learn


cdef class AdvanceTable(Record):
    cdef public double[:, ::1] decay
    cdef public double[:, ::1] hold
    cdef public double[:, ::1] ramp
    cdef public double[:, ::1] heat_decay
    cdef public double[:, :, ::1] couple


cdef class StepTable(AdvanceTable):
    cdef public double[:, :, ::1] noise
    cdef public double[:, :, :, ::1] walk_xx
    cdef public double[:, :, ::1] walk_dx


cdef class AdvanceWork(Record):
    cdef public double[::1] law
    cdef public double[::1] driven
    cdef public double[:, ::1] before
    cdef public double[:, ::1] none
    cdef public double[:, ::1] link
    cdef public double[:, :, :, ::1] sweep


cdef class Work(AdvanceWork):
    cdef public double[::1] plain
    cdef public double[:, ::1] plain_B
    cdef public double[:, ::1] B
    cdef public double[:, ::1] C
    cdef public double[:, ::1] rows
    cdef public double[::1] value
    cdef public double[::1] shared
    cdef public double[:, ::1] couple
    cdef public double[::1] shift
    cdef public double[:, ::1] was
    cdef public double[:, ::1] G
    cdef public double[:, ::1] H
    cdef public double[:, ::1] M
    cdef public double[:, ::1] L
    cdef public double[:, ::1] W
    cdef public double[::1] e
    cdef public Py_ssize_t[::1] order
    cdef public double[::1] K
    cdef public double[::1] row
    cdef public double[::1] half
    cdef public double[:, ::1] g
    cdef public double[::1] nu
    cdef public double[::1] S_nu
    cdef public unsigned char[::1] usable
    cdef public unsigned char[::1] accepted
    cdef public double[::1] suspect
    cdef public double[:, ::1] A
    cdef public double[::1] before_around
    cdef public double[:, ::1] kept
    cdef public double[:, ::1] CT
    cdef public double[:, ::1] S
    cdef public double[::1] read


cdef class Inputs(Record):
    cdef public double[::1] time_s
    cdef public double[::1] dt_s
    cdef public double[:, ::1] y_degC
    cdef public unsigned char[:, ::1] usable
    cdef public signed char[:, ::1] quality
    cdef public double[:, ::1] law_W
    cdef public double[:, ::1] law_jump_W
    cdef public double[:, ::1] z_start
    cdef public double[:, ::1] z_end
    cdef public double[:, :, ::1] moving_B
    cdef public double[:, :, ::1] moving_C
    cdef public signed char[::1] degraded
    cdef public double[::1] loss_1_s
    cdef public double[::1] loss_degC


cdef class Running(Record):
    cdef public double[::1] x
    cdef public double[:, ::1] P
    cdef public double[::1] suspect
    cdef public double[::1] refused_s
    cdef public double[::1] opened_K
    cdef public double[::1] lost_s
    cdef public Py_ssize_t[::1] flags
    cdef public double[::1] around
    cdef public double[:, ::1] guard
    cdef public double[::1] verdict


cdef class Results(Record):
    cdef public double[:, ::1] heat
    cdef public double[:, ::1] heat_sigma
    cdef public double[:, ::1] field
    cdef public double[:, ::1] field_sigma
    cdef public double[:, ::1] innovation
    cdef public signed char[:, ::1] sensor_quality
    cdef public signed char[::1] quality
    cdef public double[::1] log_likelihood
    cdef public double[:, ::1] innovation_sigma
    cdef public double[:, ::1] law
    cdef public double[:, ::1] learned
    cdef public double[:, ::1] learned_sigma
    cdef public double[:, ::1] heat_bound
    cdef public double[:, ::1] field_bound


cdef class Gathered(Record):
    cdef public double[::1] span
    cdef public double[::1] law_J
    cdef public double[::1] jump_W2
    cdef public double[::1] z_first
    cdef public double[::1] z_last
    cdef public Py_ssize_t[::1] moving
    cdef public double[::1] weight
    cdef public double[:, ::1] B
    cdef public double[:, ::1] plain_B
    cdef public double[:, ::1] C
    cdef public double[::1] y_degC
    cdef public unsigned char[::1] seen
    cdef public unsigned char[::1] free
    cdef public double[::1] loss


cdef class Held(Record):
    cdef public double[::1] heat_W
    cdef public double[::1] field
    cdef public double[::1] heat_drift_W2
    cdef public double[::1] field_drift2
    cdef public double[::1] limit


cdef class GainTable(Record):
    cdef public Py_ssize_t[::1] key
    cdef public double[:, :, ::1] K
    cdef public unsigned char[::1] steady
    cdef public double[:, :, ::1] P
    cdef public double[:, ::1] slack
    cdef public double[:, ::1] S
    cdef public double[:, ::1] heat_sigma
    cdef public double[:, ::1] field_sigma


cdef class StepBins(Record):
    cdef public Py_ssize_t[::1] number
    cdef public unsigned char[::1] exact


cdef class SteadyStep(Record):
    cdef public double[::1] decay
    cdef public double[:, ::1] drives
    cdef public double[:, ::1] sensors
    cdef public double[:, ::1] inputs
    cdef public double[:, ::1] seen
    cdef public double[:, ::1] push
    cdef public double[:, ::1] rows
    cdef public double[:, ::1] weights
    cdef public double[::1] forced
    cdef public double[:, ::1] states
    cdef public double[:, ::1] value
    cdef public double[::1] nu_sigma
    cdef public double[::1] gate_K2
    cdef public double[::1] jump_W2
    cdef public unsigned char[::1] present


cdef class Considered(Record):
    cdef public PlantArrays plant
    cdef public Work work
    cdef public double[::1] around
    cdef public double[:, ::1] S
    cdef public double[::1] nothing
    cdef public double[:, ::1] nu
    cdef public double[::1] variance
    cdef public double[::1] e
    cdef public Py_ssize_t[::1] taken


cdef class Tape(Record):
    cdef public signed char[::1] kind
    cdef public double[:, :, ::1] gain
    cdef public double[:, ::1] weight
    cdef public double[:, ::1] innovation
    cdef public double[:, ::1] heat
    cdef public double[:, :, ::1] cross
    cdef public double[:, :, ::1] coupled


cdef class Adjoint(Record):
    cdef public double[::1] r
    cdef public double[:, ::1] N
    cdef public double[::1] NK


cdef class Smoothed(Record):
    cdef public double[:, ::1] heat
    cdef public double[:, ::1] sigma
    cdef public double[:, ::1] residual


cdef class ColumnsRead(Record):
    cdef public Py_ssize_t[::1] sensors
    cdef public Py_ssize_t[::1] known
    cdef public double[::1] shift_K
    cdef public double[::1] rate_K_h
    cdef public Py_ssize_t[::1] needed
    cdef public Py_ssize_t[::1] nuts
    cdef public Py_ssize_t ambient
    cdef public Py_ssize_t reference


cdef class Expected(Record):
    cdef public double[::1] expected_s
    cdef public double[::1] noise_K
    cdef public double period_s
    cdef public double[::1] low
    cdef public double[::1] high
    cdef public double[::1] rate_per_s
    cdef public double[::1] above_K
    cdef public double[::1] below_K
    cdef public double[::1] slack
    cdef public Py_ssize_t ambient
    cdef public double ambient_degC
    cdef public Py_ssize_t[::1] position
    cdef public Py_ssize_t[::1] speed
    cdef public double[::1] lead_m


cdef class Memory(Record):
    cdef public double[::1] value
    cdef public double[::1] seen_s
    cdef public double[::1] gap_s
    cdef public signed char[::1] newest
    cdef public unsigned char[::1] arrived
    cdef public unsigned char[::1] stuck
    cdef public signed char[::1] breach
    cdef public double[::1] refused
    cdef public double[:, ::1] noise
    cdef public double[:, ::1] passed
    cdef public double[::1] last_tick_s


cdef class SelfTestState(Record):
    cdef public double[:, :, ::1] sensor
    cdef public double[:, ::1] last
    cdef public double[:, ::1] heat
    cdef public double[::1] peak_W
    cdef public double[:, ::1] motion
    cdef public double[::1] since_s
    cdef public double[::1] value
    cdef public double[::1] expected
    cdef public double[::1] steps
    cdef public double[::1] first_s
    cdef public double[::1] refused


cdef class Trust(Record):
    cdef public double[::1] initial_W
    cdef public double[::1] law_uncertainty
    cdef public double[::1] noise_K
    cdef public double law_slack


cdef class Tested(Record):
    cdef public double[::1] time_s
    cdef public double[::1] dt_s
    cdef public signed char[:, ::1] given
    cdef public signed char[:, ::1] sensor_quality
    cdef public double[:, ::1] nu
    cdef public double[:, ::1] nu_sigma
    cdef public double[:, ::1] heat_W
    cdef public double[:, ::1] heat_sigma_W
    cdef public double[:, ::1] law_W
    cdef public double[:, ::1] motion


cdef class Rows(Record):
    cdef public double[::1] time_s
    cdef public double[::1] late_s
    cdef public unsigned char[::1] step
    cdef public double[:, ::1] values
    cdef public unsigned char[:, ::1] present
    cdef public unsigned char[:, ::1] faulted


cdef class Frames(Record):
    cdef public double[::1] time_s
    cdef public double[::1] dt_s
    cdef public double[:, ::1] values
    cdef public unsigned char[:, ::1] fresh
    cdef public signed char[:, ::1] quality
    cdef public double[:, ::1] age_s
    cdef public double[:, :, ::1] samples
    cdef public Py_ssize_t[:, ::1] offset
    cdef public Py_ssize_t[::1] end
    cdef public unsigned char[::1] counts


cdef class DriveDesk(Record):
    cdef public double[::1] time_s
    cdef public double[:, ::1] values
    cdef public unsigned char[:, ::1] fresh
    cdef public signed char[:, ::1] quality
    cdef public double[::1] law_before_W
    cdef public double[::1] z_before
    cdef public double[:, ::1] law
    cdef public double[:, ::1] known
    cdef public double[:, ::1] z_start
    cdef public double[:, ::1] z_end
    cdef public double[:, ::1] law_W
    cdef public double[:, ::1] jump_W
    cdef public double[:, ::1] y_degC
    cdef public unsigned char[:, ::1] usable
    cdef public signed char[:, ::1] sensor_quality
    cdef public signed char[::1] degraded


cdef class NutTable(Record):
    cdef public double[::1] mu_1_m
    cdef public double[::1] phase
    cdef public double[::1] scale
    cdef public double conductance_W_m
    cdef public double nut_m
    cdef public double screw_m
    cdef public double stroke_m
    cdef public Py_ssize_t lag
    cdef public double lag_decay_1_s
    cdef public double[:, ::1] table_C
    cdef public double[::1] mean_B
    cdef public double[::1] mean_C
    cdef public double[:, ::1] turn


cdef class NutDesk(Record):
    cdef public double[::1] scalars
    cdef public double[::1] weight_s
    cdef public double[::1] B
    cdef public double[::1] C
    cdef public double[::1] sum_B
    cdef public double[::1] sum_C
    cdef public double[:, ::1] out_B
    cdef public double[:, ::1] out_C
    cdef public double[::1] step_B
    cdef public double[::1] step_C
