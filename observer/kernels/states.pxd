# What state machines remember, number by number. Numpy's types of the same memory are made from these lines (see
# `setup.py` and `layout.state_type`).

# Of a sensor, by the screening of readings.
cdef struct SensorGuard:
    # mean of its innovations, over how many samples, and the time since the last of them
    double mean_K, samples, since_s
    # samples in a row that are off by a step, for how long, and by what step
    double pending, pending_s, step_K
    # why it is excluded (0: it is not) and for how long; how much too high it reads, with what σ; how long it agrees
    double cause, out_s, excess_K, excess_sigma_K, agrees_s
    # the last reading that was used, and the part of its samples that stepped
    double value_degC, unrest
    # when it was first excluded, in how many steps, and by how many places behind it its exchanged partner is
    double first_out_s, steps_out, partner
    # what was lately added to the variance of its offset
    double opened_K2
    # how far off it was when it was excluded, and whether it has stepped back by that
    double size_K, stepped_back

# Of all sensors together.
cdef struct ScreeningVerdict:
    # how long all inputs have been known; how long the estimate still settles, or is held not good
    double age_s, settling_s, hold_s
    # what cannot be explained, and since when
    double latch, latched_s
    # the offset of all thermocouples, and since when; the factor of a gain
    double common_K, common_from_s, factor
    double latch_steps, common_steps
    # what was lately added to P: shares of the prior, and to the variance of what offsets have in common
    double opened_prior, opened_common_K2
    # since when the estimate settles or is held not good, until when, and in how many steps it ever was
    double held_from_s, held_until_s, held_steps
    # the air's last reading, for how long it has not changed, by how much it has leapt, and whether it ever came
    double air_degC, air_same_s, air_off_K, air_known
    # how long the estimator has run, whatever was lost meanwhile
    double runs_s

# Of a nut's motion, by the self-test.
cdef struct NutMotion:
    # lately: the way made, and the way that the speed allows
    double made_m, allowed_m
    # the last sample: when, where, how fast, and how old that speed was
    double time_s, place_m, speed_m_s, speed_age_s
    # samples of a turning screw, the usual time between samples, how late the last one and all of them may be
    double samples, usual_s, later_s, late_s
    # for how long, and over what turned way, the position has repeated on a turning screw; its slowest refresh
    double repeats_s, repeats_m, refresh_s
    # the sum of the jumps, since when, and whether way and speed have disagreed since; the travel before it
    double jump_m, jumped_s, disagreed, lowest_m, highest_m
    # the jump that temperatures are compared with, and for what time and way they have agreed
    double judged_m, agreed_s, agreed_travels
    # of the recent way, what polls leave open: the variance, and the most
    double open_m2, open_m

# What a step shows of a nut: the ratio of the ways made and allowed, the sum of its jumps, and its way in travels.
cdef struct MotionStep:
    double ratio, jump_m, travels

# Of a sensor's normalised innovations over one window: the means of itself, of its product with the one before, of
# its square; the variance factor of such a mean; the mean of the part that lasts.
cdef struct InnovationWindow:
    double mean, product, square, variance, lasting

cdef struct LastInnovation:
    double nu, time_s

# Of a nut's path.
cdef struct PathMemory:
    # the last sample: when and where; the velocity over the step to it, 0 unless at full speed; the full speed
    double time_s, here_m, velocity_m_s, speed_m_s
    # the places where it turned last, NaN while unknown; speed times lead at the last sample, NaN where unknown
    double low_m, high_m, driven_m_s
    # the sense in which it runs, and the farthest place that it has come to in it
    double sense, far_m
    # the steps made, and the speeds of the last of them
    double count
    double[16] recent_m_s

# Of the noise of a channel: its last value and change; the mean bend of three samples, now and before it repeated;
# how often it repeats in a row, the longest such run, and the samples since the start.
cdef struct ChannelNoise:
    double last, delta, bend, bend_before, run, longest, samples
