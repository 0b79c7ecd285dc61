cdef class Record:
    pass


cdef class Links(Record):
    cdef public Py_ssize_t[::1] source
    cdef public double[::1] conductance_W_K
    cdef public double[:, ::1] C, B


cdef class Spreads(Record):
    cdef public Py_ssize_t[::1] first
    cdef public double[::1] rate_1_s, swept, at_rest
    cdef public double[:, ::1] row, into


cdef class Fades(Record):
    cdef public double[::1] per_K, reference_degC


cdef class Uneven(Record):
    cdef public double[::1] rate
    cdef public double[:, ::1] row, into


cdef class Coupling(Record):
    cdef public bint active
    cdef public Py_ssize_t ambient, modes
    cdef public double conductance_W_m, square, radiation, rising, zero_degC_K
    cdef public double[::1] place_gain, uniform, mean
    cdef public double[:, ::1] under_C, under_F, metric, non_modal_rows, non_modal_into
    cdef public Links links
    cdef public Spreads spreads
    cdef public Fades fades
    cdef public Uneven uneven


cdef class LearningArrays(Record):
    cdef public Py_ssize_t machine, ambient, rests
    cdef public Py_ssize_t[::1] kind, of, considered, law, divided, link, first, heated
    cdef public double[::1] sigma, shift_K, lag_s
    cdef public double[:, ::1] rate_1_s, into, feedback_row, heats, steady, row, row_known, rest_P, V, inverse
    cdef public double[:, :, ::1] inputs


cdef class AdvancePlant(Record):
    cdef public Py_ssize_t modes
    cdef public double[:, ::1] B, E
    cdef public Py_ssize_t[::1] source, moving
    cdef public Coupling coupling


cdef class PlantArrays(AdvancePlant):
    cdef public double[:, ::1] C, F, rows, rows_F, lags, prior_P, VT, inverse_T
    cdef public double[::1] R_K2, uniform, initial_W2, jump_uncertainty
    cdef public Py_ssize_t[::1] moving_heat
    cdef public unsigned char[::1] thermal
    cdef public LearningArrays learn


cdef class AdvanceTable(Record):
    cdef public double[:, ::1] decay, hold, ramp, heat_decay
    cdef public double[:, :, ::1] couple


cdef class StepTable(AdvanceTable):
    cdef public double[:, :, ::1] noise, walk_dx
    cdef public double[:, :, :, ::1] walk_xx


cdef class StepMatrices(Record):
    cdef public double dt_s
    cdef public double[::1] decay, hold, ramp, heat_decay, walk_dd
    cdef public double[:, ::1] couple, walk_dx
    cdef public double[:, :, ::1] walk_xx


cdef class CoupledColumns(Record):
    cdef public double[:, ::1] X, inputs, sums


cdef class AdvanceWork(Record):
    cdef public double[::1] law, driven
    cdef public double[:, ::1] B, C, before, link
    cdef public CoupledColumns state
    cdef public double[:, :, :, ::1] sweep


cdef class Work(AdvanceWork):
    cdef public CoupledColumns half_step
    cdef public double[::1] plain, value, shared, shift, e, K, row, half, nu, S_nu, suspect
    cdef public double[::1] before_around, read, made_of
    cdef public double[:, ::1] plain_B, rows, half_step_T, was, G, H, M, L, W, g, A, saved, CT, S
    cdef public Py_ssize_t[::1] order
    cdef public unsigned char[::1] usable, accepted


cdef class Inputs(Record):
    cdef public double[::1] time_s, dt_s, loss_1_s, loss_degC
    cdef public double[:, ::1] y_degC, law_W, law_jump_W, z_start, z_end
    cdef public unsigned char[:, ::1] usable
    cdef public signed char[:, ::1] quality
    cdef public double[:, :, ::1] moving_B, moving_C
    cdef public signed char[::1] degraded


cdef class OpenLoopMarch(Record):
    cdef public AdvancePlant plant
    cdef public AdvanceTable table
    cdef public Inputs inputs
    cdef public AdvanceWork work
    cdef public double[::1] decay_1_s


cdef class Batch(Record):
    cdef public PlantArrays plant
    cdef public StepTable table
    cdef public Inputs inputs
    cdef public Py_ssize_t[::1] step
    cdef public double gate_sigma


cdef class Running(Record):
    cdef public double[::1] x, suspect, refused_s, opened_K, lost_s, around
    cdef public double[:, ::1] P
    cdef public SensorGuard[::1] guard
    cdef public ScreeningVerdict[::1] verdict
    cdef public Py_ssize_t[::1] flags


cdef class Results(Record):
    cdef public double[:, ::1] heat, heat_sigma, field, field_sigma, innovation, innovation_sigma
    cdef public double[:, ::1] law, learned, learned_sigma, heat_bound, field_bound
    cdef public signed char[:, ::1] sensor_quality, part_quality
    cdef public signed char[::1] quality
    cdef public double[::1] log_likelihood


cdef class Gathered(Record):
    cdef public double[::1] span, law_J, jump_W2, z_first, z_last, weight, y_degC, loss
    cdef public Py_ssize_t[::1] moving
    cdef public double[:, ::1] B, plain_B, C, ahead, ahead_degC
    cdef public unsigned char[::1] fresh, free


cdef class BankBounds(Record):
    cdef public double[::1] heat_W, field, heat_drift_W2, field_drift2, law_change_W2, limit, known_sigma
    cdef public Py_ssize_t grid
    cdef public bint published
    cdef public double sigmas


cdef class BankFilters(Record):
    cdef public Gathered gathered
    cdef public Py_ssize_t drifting
    cdef public tuple filters, results
    cdef public unsigned char[:, ::1] uses
    cdef public Work work
    cdef public double[:, ::1] misfit, S


cdef class GainTable(Record):
    cdef public Py_ssize_t[::1] key
    cdef public double[:, :, ::1] K


cdef class FixedGainWork(Record):
    cdef public double settling_s
    cdef public Py_ssize_t[::1] at, bins
    cdef public Work work
    cdef public GainTable gains


cdef class Sensitivities(Record):
    cdef public PlantArrays plant
    cdef public Work work
    cdef public double[::1] around, nothing
    cdef public double[:, ::1] S


cdef class Tape(Record):
    cdef public signed char[::1] kind
    cdef public double[:, :, ::1] gain, cross, coupled
    cdef public double[:, ::1] weight, innovation, heat


cdef class Adjoint(Record):
    cdef public double[::1] r, NK
    cdef public double[:, ::1] N


cdef class Changed(Record):
    cdef public double[:, :, ::1] moved, heat


cdef class Smoothed(Record):
    cdef public double[:, ::1] heat, sigma, residual, free, jump, jump_sigma


cdef class ColumnsRead(Record):
    cdef public Py_ssize_t[::1] sensors, inputs, required, nuts
    cdef public double[::1] shift_K, rate_K_h
    cdef public Py_ssize_t ambient, reference


cdef class Expected(Record):
    cdef public double[::1] expected_s, heartbeat_s, noise_K, low, high, rate_per_s, above_K, below_K, slack
    cdef public double[::1] lead_m
    cdef public double period_s, ambient_degC
    cdef public Py_ssize_t ambient
    cdef public Py_ssize_t[::1] position, speed


cdef class Memory(Record):
    cdef public double[::1] value, seen_s, gap_s, refused, last_tick_s
    cdef public signed char[::1] newest, breach
    cdef public unsigned char[::1] arrived, stuck
    cdef public ChannelNoise[::1] noise
    cdef public double[:, ::1] passed


cdef class SelfTestState(Record):
    cdef public InnovationWindow[:, ::1] sensor
    cdef public LastInnovation[::1] last
    cdef public double[:, ::1] heat
    cdef public NutMotion[::1] motion
    cdef public double[::1] peak_W, since_s, value, expected, steps, first_s, refused


cdef class Trust(Record):
    cdef public double[::1] initial_W, law_uncertainty, noise_K
    cdef public double law_slack


cdef class Tested(Record):
    cdef public double[::1] time_s, dt_s
    cdef public signed char[:, ::1] input_quality, sensor_quality
    cdef public double[:, ::1] nu, nu_sigma, heat_W, heat_sigma_W, law_W
    cdef public MotionStep[:, ::1] motion


cdef class Rows(Record):
    cdef public double[::1] time_s, late_s
    cdef public unsigned char[::1] step
    cdef public double[:, ::1] values
    cdef public unsigned char[:, ::1] present, faulted


cdef class Frames(Record):
    cdef public double[::1] time_s, dt_s
    cdef public double[:, ::1] values, age_s
    cdef public unsigned char[:, ::1] fresh
    cdef public signed char[:, ::1] quality
    cdef public double[:, :, ::1] samples
    cdef public Py_ssize_t[:, ::1] offset
    cdef public Py_ssize_t[::1] end
    cdef public unsigned char[::1] counts


cdef class DriveDesk(Record):
    cdef public double[::1] time_s, law_before_W, z_before
    cdef public double[:, ::1] values, law, z, z_start, z_end, law_W, jump_W, y_degC
    cdef public unsigned char[:, ::1] fresh, usable
    cdef public signed char[:, ::1] quality, sensor_quality
    cdef public signed char[::1] degraded


cdef class NutPath(Record):
    cdef public const double[::1] time_s, position_m, driven_m_s, speed_age_s
    cdef public const Py_ssize_t[::1] offset


cdef class NutTable(Record):
    cdef public double[::1] mu_1_m, phase, scale, mean_B, mean_C
    cdef public double conductance_W_m, nut_m, screw_m, stroke_m, lag_decay_1_s
    cdef public Py_ssize_t lag
    cdef public double[:, ::1] table_C, turn


cdef class NutDesk(Record):
    cdef public PathMemory[::1] path
    cdef public double[::1] weight_s, B, C, sum_B, sum_C, step_B, step_C
    cdef public double[:, ::1] out_B, out_C
