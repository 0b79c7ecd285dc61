"""Compensation tables in the formats that controls read at their start.

LinuxCNC: `COMP_FILE` of type 1. Its rows are nominal position, forward and reverse trim in mm, which are
added to the position (`usrmotLoadComp`: a trim is nominal minus actual).

SINUMERIK: `$AA_ENC_COMP` of an encoder, in mm. A positive value moves the axis in the negative direction. The
value at the reference should be zero (Function Manual Extended Functions, 03/2013, K3, 4.4.2).

Klipper has no table along an axis: `[z_thermal_adjust]` is one factor of one sensor, and moves Z down by it
for each K.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from observer.frames import FloatArray

MM_PER_M, MM_PER_UM = 1000.0, 1e-3


class ControlTable(NamedTuple):
    """A file's name and text, and sentences about its use.

    Attributes:
        name: The file's name.
        text: Its content, in the control's format and units.
        facts: What to set at the control, and what the table cannot do.
    """

    name: str
    text: str
    facts: tuple[str, ...]

    def leaving(self, left_um: float) -> ControlTable:
        """Return the table, with a sentence on any error that the slope limit leaves uncorrected.

        Args:
            left_um: The largest such error over the travel, in µm; below 0.05 µm the table is returned
                unchanged.
        """
        if left_um < 0.05:
            return self
        words = f"compensation.gradient_limit_um_m limits the slope, which leaves {left_um:.1f} um at most."
        return self._replace(facts=(*self.facts, words))


def linuxcnc(machine_m: FloatArray, error_um: FloatArray, title: str, axis: str) -> ControlTable:
    """Return a compensation file of LinuxCNC, with trims in mm.

    Args:
        machine_m: Positions (n,) in the machine's coordinates, in m, in any order.
        error_um: Thermal error (n,) at these positions, in µm.
        title: One line that identifies configuration and log.
        axis: The axis' letter, for the file's name.

    Returns:
        The table, with its rows from the lowest position on.
    """
    order = np.argsort(machine_m)
    rows = [
        f"{MM_PER_M * x:.4f} {trim:.6f} {trim:.6f}"
        for x, trim in zip(machine_m[order], -MM_PER_UM * error_um[order], strict=True)
    ]
    name = f"{axis.lower()}-thermal.comp"
    facts = (
        f"In [JOINT_n] of the INI file: COMP_FILE = {name} and COMP_FILE_TYPE = 1, for a machine in mm.",
        "LinuxCNC reads it when it starts; it is right for the state of the log's end alone.",
    )
    return ControlTable(name, "\n".join(rows) + "\n", (title, *facts))


def sinumerik(
    machine_m: FloatArray, error_um: FloatArray, title: str, axis: str, reference: int
) -> ControlTable:
    """Return the values of the first encoder's table in mm, zero at the reference.

    Args:
        machine_m: Equidistant positions (n,) in the machine's coordinates, in m, in any order.
        error_um: Thermal error (n,) at these positions, in µm.
        title: One line that identifies configuration and log, written as a comment.
        axis: The name of the axis in the channel.
        reference: Index of the position where the table is zero.

    Returns:
        The table; a fact gives the error at the reference, which belongs into a work offset.
    """
    order = np.argsort(machine_m)
    at_mm = MM_PER_M * machine_m[order]
    offset_um = float(error_um[reference])
    values_mm = MM_PER_UM * (error_um[order] - offset_um)
    head = f"%_N_{axis.upper()}_EEC_INI\n; {title}\nCHANDATA(1)\n"
    rows = [f"$AA_ENC_COMP[0,{k},{axis}]={value:.6f}" for k, value in enumerate(values_mm)]
    tail = [
        f"$AA_ENC_COMP_STEP[0,{axis}]={(at_mm[-1] - at_mm[0]) / (len(at_mm) - 1):.6f}",
        f"$AA_ENC_COMP_MIN[0,{axis}]={at_mm[0]:.6f}",
        f"$AA_ENC_COMP_MAX[0,{axis}]={at_mm[-1]:.6f}",
        f"$AA_ENC_COMP_IS_MODULO[0,{axis}]=0",
        "M17",
    ]
    facts = (
        f"MD38000 $MA_MM_ENC_COMP_MAX_POINTS[0,{axis}] must be {len(rows)} or more; load the file with "
        "MD32700 $MA_ENC_COMP_ENABLE[0] = 0, then set it to 1.",
        f"The table is zero at the reference, {MM_PER_M * machine_m[reference]:g} mm. The remaining "
        f"{offset_um:.1f} um there are not in the table: put them into a work offset.",
    )
    return ControlTable(f"{axis.lower()}_eec.ini", head + "\n".join([*rows, *tail]) + "\n", facts)


def klipper(
    sensors: tuple[str, ...], temperature_degC: FloatArray, error_um: FloatArray, title: str
) -> ControlTable:
    """Return the factor of the sensor that best explains the error at one position.

    The factor is a least-squares fit of deviations from the means over the log.

    Args:
        sensors: The names (s,) of the thermocouples.
        temperature_degC: Their readings (K, s) in °C.
        error_um: Thermal error (K,) at one position, in µm.
        title: One line that identifies configuration and log, written as a comment.

    Returns:
        A section `[z_thermal_adjust]` with the factor in mm/K; a fact gives the error that remains, in µm
        r.m.s.
    """
    away_um = error_um - error_um.mean()
    rises_K = temperature_degC - temperature_degC.mean(axis=0)
    squares = np.maximum(np.sum(rises_K**2, axis=0), 1e-12)
    factor_um_K = rises_K.T @ away_um / squares
    rest_um = np.sqrt(np.mean((away_um[:, None] - rises_K * factor_um_K) ** 2, axis=0))
    best = int(np.argmin(rest_um))
    text = (
        f"# {title}\n# sensor: {sensors[best]}; fill in sensor_type and sensor_pin\n[z_thermal_adjust]\n"
        f"temp_coeff: {MM_PER_UM * factor_um_K[best]:.6f}\n"
    )
    facts = (
        f"{sensors[best]} explains the error at the reference to {rest_um[best]:.2f} um r.m.s. of "
        f"{np.sqrt(np.mean(away_um**2)):.2f} um.",
        "Klipper has no table along an axis: this is one factor for Z, the same at every position.",
    )
    return ControlTable("z_thermal_adjust.cfg", text, facts)
