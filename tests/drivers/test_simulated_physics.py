"""The simulated machine's own physics, held to closed forms."""

import numpy as np
import pytest

from drivers.simulated import machine as simulated
from drivers.simulated.faults import Faults
from drivers.simulated.housings import SENSORS, HousedMachine
from drivers.simulated.machine import (
    PROGRAMME,
    STROKE_M,
    FiniteVolumeScrew,
    ScrewData,
    SimulatedMachine,
    heats,
    speed_rpm,
)
from drivers.simulated.wires import icpdas_m7018, wago_750_458


def test_heat_is_conserved_without_a_film():
    rod = ScrewData(film_W_m2K=0.0)
    screw = FiniteVolumeScrew(rod)
    heat_W = 30.0 * screw.spread(0.3, 0.38)
    for _ in range(100):
        screw.step(0.5, heat_W)
    volume_m3 = np.pi * rod.diameter_m**2 / 4 * rod.length_m
    capacity_J_K = rod.density_kg_m3 * rod.specific_heat_J_kgK * volume_m3
    rise_K = float(np.mean(screw.temperature_degC)) - rod.ambient_degC
    assert rise_K == pytest.approx(30.0 * 50.0 / capacity_J_K, rel=1e-9)  # a linear solve, no more


def test_the_steady_field_is_the_fin_solution():
    """Heat in at the left end of an insulated-tip fin: θ = q cosh m(L−x) / (k A m sinh m L)."""
    rod = ScrewData(cells=400)
    screw = FiniteVolumeScrew(rod)
    heat_W = np.zeros(rod.cells)
    heat_W[0] = 10.0
    for _ in range(200):
        screw.step(1000.0, heat_W)  # backward Euler: long steps go to the steady state
    area_m2 = np.pi * rod.diameter_m**2 / 4
    m_1_m = np.sqrt(4 * rod.film_W_m2K / (rod.conductivity_W_mK * rod.diameter_m))
    x_m = np.array([0.1, 0.3, 0.6, 0.9])
    theta_K = 10.0 * np.cosh(m_1_m * (rod.length_m - x_m))
    theta_K /= rod.conductivity_W_mK * area_m2 * m_1_m * np.sinh(m_1_m * rod.length_m)
    # half a cell of offset at the heated end: 0.00125 m of a fin with m ≈ 5.8 1/m
    assert screw.at(x_m) - rod.ambient_degC == pytest.approx(theta_K, rel=0.01)


def test_the_share_under_a_stretch_sums_to_one_wherever_it_lies():
    screw = FiniteVolumeScrew(ScrewData())
    for from_m in np.linspace(0.0, 0.92, 50):
        assert screw.spread(from_m, from_m + 0.08).sum() == pytest.approx(1.0, abs=1e-12)


def test_the_nut_stays_in_its_stroke_and_moves_by_the_lead():
    axis = SimulatedMachine(seed=1)
    before_m = axis.nut_position_m()
    moved_m = []
    for _ in range(2000):
        axis.advance(0.02)
        assert STROKE_M[0] <= axis.nut_position_m() - 0.04
        assert axis.nut_position_m() + 0.04 <= STROKE_M[1]
        moved_m.append(abs(axis.nut_position_m() - before_m))
        before_m = axis.nut_position_m()
    # 1500 rpm, 10 mm: 5 mm in 20 ms, less only where it turns
    assert max(moved_m) == pytest.approx(0.005)
    assert np.median(moved_m) == pytest.approx(0.005)


def test_friction_is_not_what_a_nominal_law_says():
    nominal_W = simulated.NOMINAL_SHARE * simulated.NOMINAL_TORQUE_NM * speed_rpm(0.0) * np.pi / 30
    shares = [heats(t).nut_W / nominal_W for t in (0.0, 100.0, 200.0)]
    assert all(1.05 < share < 1.15 for share in shares)
    assert len(set(shares)) == 3
    pause_s = PROGRAMME[0][0] + 1.0
    assert heats(pause_s) == simulated.TrueHeats(0.0, 0.0, 0.0)


def test_the_same_seed_gives_the_same_noise():
    assert SimulatedMachine(3).thermocouples_degC() == SimulatedMachine(3).thermocouples_degC()
    assert SimulatedMachine(3).thermocouples_degC() != SimulatedMachine(4).thermocouples_degC()


def test_modules_show_faults_as_the_real_ones_do():
    values = {"t1_degC": -0.1, "t2_degC": 25.04, "t3_degC": 30.0}
    faults = Faults(open="t2_degC", over_range=("t3_degC",))
    assert wago_750_458(values, faults) == [0, 0xFFFF, 0x60, 0x7FFF, 0x42, 13000]
    assert icpdas_m7018(values, faults) == [0xFFFF, 0x7FFF, 300]


def test_what_bodies_beside_the_screw_take_and_lose_is_all_the_heat(monkeypatch):
    """Without films and losses, what friction makes is in screw and bodies."""
    monkeypatch.setattr(simulated, "ScrewData", lambda: ScrewData(film_W_m2K=0.0))
    machine, made_J = HousedMachine(seed=1), 0.0
    machine._air_W_K = np.zeros(3)
    for _ in range(600):
        true = machine.heats()
        made_J += 0.1 * (true.nut_W + true.left_bearing_W + true.right_bearing_W)
        machine.advance(0.1)
    screw_J = machine._screw._capacity_J_K * float(np.sum(machine._screw.temperature_degC - 22.0))
    bodies_J = float(machine._capacity_J_K @ (machine._body_degC - 22.0))
    assert screw_J + bodies_J == pytest.approx(made_J, rel=1e-9)  # a linear solve and sums
    assert 0.1 * made_J < bodies_J < 0.9 * made_J
    assert tuple(machine.thermocouples_degC()) == SENSORS
