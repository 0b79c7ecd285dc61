"""The configuration's tables of physical laws: bearing and nut friction, and the film of the surface."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from observer.config import quantities
from observer.config.quantities import Section

Efficiency = Annotated[quantities.Number, Field(gt=0.5, lt=1)]
Load = Annotated[quantities.NonNegative, Field(le=1e9)]
Viscosity = Annotated[quantities.Positive, Field(ge=0.01, le=1e6)]
FilmLaw = Literal["churchill-chu", "wall", "rotating-cylinder", "kendoush", "taylor-gap"]


class BearingFriction(Section):
    """Palmgren's friction of a rolling bearing, as a source's heat law (Palmgren 1959; Yu et al. 2024,
    §3.1.1).

    Load, load factor f₁ and viscosity can each be given in two ways. Anything but exactly one complete way is
    rejected.
    """

    #: `"angular_contact"`, `"angular_contact_pair"` (or two rows) or `"deep_groove"`
    type: Literal["angular_contact", "angular_contact_pair", "deep_groove"]
    mean_diameter_m: quantities.Diameter  #: half of bore plus outer diameter
    load_N: Load | None = None  #: the load that causes friction; or give `axial_load_N`
    axial_load_N: Load | None = None  #: axial load, preload included
    radial_load_N: Load | None = None  #: radial load in addition
    #: lubrication factor; – is the bearing type's for grease: 2, pairs 4
    f0: Annotated[quantities.Positive, Field(le=1e3)] | None = None
    #: load factor; or give `static_load_N` and `static_rating_N`
    f1: Annotated[quantities.NonNegative, Field(le=1)] | None = None
    static_load_N: Load | None = None  #: equivalent static load P₀ from the catalogue
    static_rating_N: Annotated[quantities.Positive, Field(ge=1e-3, le=1e9)] | None = None  #: static rating C₀
    #: viscosity of oil or base oil in the running bearing; or the three keys below
    viscosity_mm2_s: Viscosity | None = None
    viscosity_40_mm2_s: Viscosity | None = None  #: viscosity at 40 °C
    viscosity_100_mm2_s: Viscosity | None = None  #: viscosity at 100 °C
    lubricant_degC: quantities.Temperature | None = None  #: temperature of the running bearing
    count: Annotated[quantities.Count, Field(ge=1, le=100)] = 1  #: how many equal bearings

    @model_validator(mode="after")
    def _complete(self) -> BearingFriction:
        _exactly_one(self, ("load_N",), ("axial_load_N", "radial_load_N"), optional=("radial_load_N",))
        _exactly_one(self, ("f1",), ("static_load_N", "static_rating_N"))
        _exactly_one(
            self, ("viscosity_mm2_s",), ("viscosity_40_mm2_s", "viscosity_100_mm2_s", "lubricant_degC")
        )
        cold, hot = self.viscosity_40_mm2_s, self.viscosity_100_mm2_s
        if cold is not None and hot is not None and not cold > hot >= 2.0:
            raise ValueError(
                "viscosity_100_mm2_s is to be at least 2 mm2/s and below viscosity_40_mm2_s; fix one of them"
            )
        return self


class NutFriction(Section):
    """Friction of a ball nut from preload, load and efficiency, as a source's heat law.

    A nut without any load is rejected. Formulas: `physics.friction.preload_torque_Nm`,
    `load_friction_torque_Nm`.
    """

    efficiency: Efficiency  #: η of the nut without preload, 0.5 to 1
    preload_N: Load = 0.0  #: preload
    axial_load_N: Load = 0.0  #: mean axial load
    lead_m: quantities.Lead | None = None  #: lead of the screw, unless the source gives it

    @model_validator(mode="after")
    def _some_load(self) -> NutFriction:
        if self.preload_N == self.axial_load_N == 0.0:
            raise ValueError("nothing rubs without a load; give preload_N or axial_load_N")
        return self


LAWS = ("torque_Nm", "bearing", "nut_friction", "heat_W_rpm", "power_channel", "heat_W", "heat_of")
SPEED_LAWS = LAWS[:4]
DIVIDED_LAWS = LAWS[:3]
"""Laws of all of a friction's heat, of which `share` enters the screw."""


class HeatLaw(Section):
    """How much heat a source delivers: one law, and its factors.

    At most one law may be given. Laws of friction need `speed_channel`. Factors that do not belong to the law
    are rejected.
    """

    #: channel of the screw's speed in rpm, for laws of friction
    speed_channel: quantities.Channel | None = None
    torque_Nm: quantities.Torque | None = None  #: law: heat = scale · share · duty · torque · ω
    #: law: the same, with a bearing's torque by Palmgren: the table `[source.bearing]`
    bearing: BearingFriction | None = None
    #: law: the same, with a nut's torque by preload and efficiency: the table `[source.nut_friction]`
    nut_friction: NutFriction | None = None
    #: torque, nut friction: channel of a driven nut's speed in rpm; the law uses the relative speed
    nut_speed_channel: quantities.Channel | None = None
    #: torque: of the nut's own drive; heat = torque · ω of the screw + this · ω of the nut
    nut_torque_Nm: quantities.Torque | None = None
    heat_W_rpm: quantities.HeatPerSpeed | None = None  #: law: heat = scale · duty · this · speed
    power_channel: quantities.Channel | None = None  #: law: heat = scale · a measured power in W
    heat_W: quantities.Heat | None = None  #: law: heat = scale · this, constant
    drive_channel: quantities.Channel | None = None  #: `heat_W` flows only while this channel is not 0
    #: law: heat = scale · law of the source of this name / `heat_ratio`
    heat_of: quantities.Name | None = None
    heat_ratio: Annotated[quantities.Factor, Field(gt=0)] | None = None  #: for `heat_of`
    #: `heat_of`: follows the other source's estimated heat, without an unknown of its own. Not with
    #: `[[node]]`, `covers_film` or a measured nut position
    follows: quantities.Flag = False
    share: quantities.Share = 1.0  #: share of the friction heat that enters the screw, 0 to 1
    duty: quantities.Share = 1.0  #: duty cycle, 0 to 1, where the speed channel only holds a set speed
    #: multiplies a nut's law by stroke over length of the screw, as Kim et al. do
    stroke_share: quantities.Flag = False
    scale: quantities.Factor = 1.0  #: multiplies the law, whichever it is

    _pair = quantities.all_or_none("heat_of", "heat_ratio")

    @model_validator(mode="after")
    def _one_law(self) -> HeatLaw:
        laws = [key for key in LAWS if getattr(self, key) is not None]
        if len(laws) > 1:
            raise ValueError(f"only one heat law per source, here {' and '.join(laws)}; remove all but one")
        if laws and laws[0] in SPEED_LAWS and self.speed_channel is None:
            raise ValueError(f"{laws[0]} needs speed_channel; give the channel of the screw's speed")
        if self.follows and self.heat_of is None:
            raise ValueError("follows needs to know which heat; give heat_of and heat_ratio, or remove it")
        if self.drive_channel is not None and self.heat_W is None:
            raise ValueError("drive_channel says when heat_W flows; give heat_W or remove it")
        return self

    @model_validator(mode="after")
    def _what_belongs_to_a_law(self) -> HeatLaw:
        turning = self.torque_Nm is not None or self.nut_friction is not None
        if self.nut_speed_channel is not None and not turning:
            raise ValueError("nut_speed_channel belongs to torque_Nm or nut_friction; remove it")
        if self.nut_torque_Nm is not None and (self.torque_Nm is None or self.nut_speed_channel is None):
            raise ValueError(
                "nut_torque_Nm needs torque_Nm and nut_speed_channel too; give both, or remove it"
            )
        if self.stroke_share and not turning:
            raise ValueError("stroke_share belongs to torque_Nm or nut_friction; remove it")
        if self.duty != 1.0 and self.law not in SPEED_LAWS:
            raise ValueError(f"duty belongs to a law of the speed ({', '.join(SPEED_LAWS)}); remove it")
        return self

    @property
    def law(self) -> str | None:
        """The key of the law in use; None without one."""
        return next((key for key in LAWS if getattr(self, key) is not None), None)

    @property
    def law_channels(self) -> tuple[str, ...]:
        """The channels that the law reads, in the order of its arguments.

        For a law of friction they are the screw's speed and a driven nut's speed, else the power, or the
        drive's state.
        """
        named: tuple[str | None, ...] = (self.power_channel, self.drive_channel)
        if self.law in SPEED_LAWS:
            named = (self.speed_channel, self.nut_speed_channel)
        return tuple(channel for channel in named if channel is not None)


class Surface(Section):
    """The lateral surface; a film coefficient of 0 means that no surface loss is modelled.

    The film is a number or a law, not both. Keys of another law are rejected, and so is an incomplete thread.
    """

    #: film coefficient of the whole surface; 0 means that no loss is modelled
    convection_W_m2K: quantities.Film = 0.0
    law: FilmLaw | None = None  #: computes the film from geometry and air, in place of a number; see below
    #: law: practice factor on convection; Yu et al. take 10 and call 3 to 10 usual
    factor: Annotated[quantities.Factor, Field(gt=0)] = 1.0
    rise_K: quantities.Rise = 10.0  #: law: assumed temperature of the surface above the air
    air_degC: quantities.Air = 20.0  #: law: temperature of that air
    #: law: adds radiation, linearised at `rise_K`; 0.2 for bright steel, 0 leaves it out
    emissivity: quantities.Share = 0.0
    #: law: adds the effect of rotation at this speed; 0 is the film at standstill
    speed_rpm: quantities.Speed = 0.0
    #: law: channel of the screw's speed in rpm, in place of `speed_rpm`
    speed_channel: quantities.Channel | None = None
    #: wall: `"vertical"`, or horizontal and facing `"up"` or `"down"`
    facing: Literal["vertical", "up", "down"] | None = None
    #: wall: its height, or the length of its short side if it is horizontal
    height_m: quantities.Length | None = None
    gap_m: quantities.Length | None = None  #: taylor-gap: distance between screw and tube
    #: law: lead of the thread, whose surface raises the film; with the two keys below
    thread_lead_m: quantities.Lead | None = None
    ball_radius_m: quantities.Length | None = None  #: law: radius of the balls' groove
    land_m: quantities.Position | None = None  #: law: width of the land between two grooves
    #: law: the thread as fins of this efficiency on the cylinder
    fin_efficiency: Annotated[quantities.Positive, Field(le=1)] | None = None

    @model_validator(mode="after")
    def _law_is_complete(self) -> Surface:
        stated = self.model_fields_set
        if self.law is None:
            spare = sorted(stated - {"convection_W_m2K"})
            if spare:
                raise ValueError(f"{spare[0]} belongs to a law; give law, or remove it")
            return self
        if "convection_W_m2K" in stated:
            raise ValueError(
                f'convection_W_m2K and law = "{self.law}" both give the film; remove one of them'
            )
        for key, law in (("facing", "wall"), ("height_m", "wall"), ("gap_m", "taylor-gap")):
            if (getattr(self, key) is not None) != (self.law == law):
                raise ValueError(f'{key} belongs to law = "{law}", and is needed there; give both or neither')
        self._turning_is_given_once()
        self._thread_is_complete()
        return self

    def _turning_is_given_once(self) -> None:
        if self.turns and self.law in ("churchill-chu", "wall"):
            key = "speed_channel" if self.speed_channel else "speed_rpm"
            raise ValueError(
                f'{key} has no part in law = "{self.law}"; choose "rotating-cylinder", "kendoush" or '
                '"taylor-gap", or remove it'
            )
        if self.speed_rpm and self.speed_channel:
            raise ValueError("speed_rpm and speed_channel both give the speed; remove one of them")

    @property
    def turns(self) -> bool:
        """Whether the film depends on the screw's speed, given as a number or as a channel."""
        return self.speed_rpm > 0.0 or self.speed_channel is not None

    def _thread_is_complete(self) -> None:
        thread = ("thread_lead_m", "ball_radius_m", "land_m")
        missing = [key for key in thread if getattr(self, key) is None]
        if missing and (len(missing) < len(thread) or self.fin_efficiency is not None):
            raise ValueError(
                f"a thread needs {', '.join(thread)} together; {missing[0]} is missing; give it, or remove "
                "the others"
            )


def _exactly_one(
    table: Section, one: tuple[str, ...], other: tuple[str, ...], optional: tuple[str, ...] = ()
) -> None:
    """Raise `ValueError` unless the keys of one of the two groups are all given, and none of the other."""
    set_keys = [key for key in (*one, *other) if getattr(table, key) is not None]
    mixed = any(key in one for key in set_keys) and any(key in other for key in set_keys)
    complete = any(set(group) - set(optional) <= set(set_keys) for group in (one, other))
    if mixed or not complete:
        names = [key for key in other if key not in optional]
        raise ValueError(f"give either {' and '.join(one)}, or {' and '.join(names)}")
