"""Cases of the fault study: every kind of fault with a size that a field may see."""

from __future__ import annotations

from typing import Final

START_S: Final = 25.0
"""Start of a fault [s]: the tractor enters the first circle of the figure eight."""

SECOND_LAP_S: Final = 150.0
"""Start of a fault in the second lap [s]: the filter has seen the vehicle on all headings."""

CASES: Final = {
    "GNSS out, 1 s": "kind='gnss_out', duration_s=1.0",
    "GNSS out, 10 s": "kind='gnss_out', duration_s=10.0",
    "GNSS out, 10 s, with gyros": "kind='gnss_out', duration_s=10.0",
    "GNSS out, 10 s, second lap": f"kind='gnss_out', duration_s=10.0, start_s={SECOND_LAP_S}",
    "GNSS out, to the end": "kind='gnss_out'",
    "GNSS out, tractor only": "kind='gnss_out', receiver='tractor'",
    "GNSS frozen": "kind='gnss_frozen'",
    "GNSS jumps by 1 m": "kind='gnss_jump', offset_m=1.0, direction_deg=90.0",
    "GNSS of the trailer jumps by 1 m": "kind='gnss_jump', receiver='trailer', offset_m=1.0",
    "GNSS drifts by 2 cm/s": "kind='gnss_drift', rate_mps=0.02, duration_s=30.0",
    "GNSS outliers of 5 m, one in ten": "kind='gnss_outlier', offset_m=5.0, share=0.1",
    "GNSS float": "kind='gnss_float', duration_s=30.0",
    "GNSS late by 0.6 s": "kind='gnss_late', delay_s=0.6",
    "GNSS late by 2 s, for 20 s": "kind='gnss_late', delay_s=2.0, duration_s=20.0",
    "antennas swapped": "kind='antennas_swapped'",
    "front angle stuck": "kind='angle_stuck', sensor='steering_tractor'",
    "trailer angle stuck": "kind='angle_stuck', sensor='steering_trailer'",
    "hitch angle stuck": "kind='angle_stuck', sensor='hitch'",
    "front angle + 5 deg": "kind='angle_bias', sensor='steering_tractor', bias_deg=5.0",
    "hitch angle + 5 deg": "kind='angle_bias', sensor='hitch', bias_deg=5.0",
    "hitch angle drifts by 0.2 deg/s": "kind='angle_drift', sensor='hitch', rate_degps=0.2",
    "front angle noise of 10 deg": "kind='angle_noise', sensor='steering_tractor', sd_deg=10.0",
    "gyro + 2 deg/s": "kind='gyro_bias', body='tractor', bias_degps=2.0",
    "encoder dead": "kind='encoder_dead'",
    "encoder doubled": "kind='encoder_scaled', factor=2.0",
    "encoder reversed": "kind='encoder_scaled', factor=-1.0",
    "samples twice": "kind='samples_duplicated'",
    "stamps backward": "kind='stamps_backward', duration_s=10.0",
    "stamps 0.3 s too old": "kind='stamps_shifted', offset_s=-0.3",
    "commands lost, 1 s": "kind='commands_lost', duration_s=1.0",
    "commands lost": "kind='commands_lost'",
    "commands late by 0.4 s": "kind='commands_late', delay_s=0.4",
    "front steering stuck": "kind='front_steering_stuck'",
    "front steering stuck, 5 s": "kind='front_steering_stuck', duration_s=5.0",
    "trailer steering stuck": "kind='trailer_steering_stuck'",
    "hydrostat stuck": "kind='hydrostat_stuck'",
    "front steering slow, 5 deg/s": "kind='front_steering_slow', rate_degps=5.0",
    "trailer steering slow, 5 deg/s": "kind='trailer_steering_slow', rate_degps=5.0",
    "front steering hard over": "kind='front_steering_hard_over', side='left'",
    "trailer steering hard over": "kind='trailer_steering_hard_over', side='right'",
    "front play of 4 deg": "kind='front_steering_play', play_deg=4.0",
    "trailer play of 4 deg": "kind='trailer_steering_play', play_deg=4.0",
    "hydrostat cut": "kind='hydrostat_cut'",
    "hydrostat sluggish, 3 s": "kind='hydrostat_sluggish', time_constant_s=3.0",
    "front steering free": "kind='front_steering_free'",
    "trailer steering free": "kind='trailer_steering_free'",
    "load shifts by 0.3 m": "kind='load_shift', left_m=0.3",
    "tyre flat, rear left": "kind='tyre_flat', wheel='rear_left'",
    "gust of 800 N, 2 s": "kind='gust', force_n=800.0, direction_deg=90.0, duration_s=2.0",
    "stone, 150 Ns": "kind='stone', wheel='front_left', impulse_ns=150.0",
    "soft patch, 80 kPa": "kind='soil_patch', radius_m=4.0, cone_index_kpa=80.0",
    "ditch of 0.15 m": "kind='ditch', depth_m=0.15, width_m=1.5",
    "step of 0.15 m": "kind='step', height_m=0.15, ramp_m=1.0",
}
"""Keys of a `[[faults]]` table by the name of a case; without `start_s` it begins at `START_S`."""

EXTRAS: Final = {
    "GNSS out, 10 s, with gyros": "sensors.imu.on=true",
    "gyro + 2 deg/s": "sensors.imu.on=true",
    "load shifts by 0.3 m": "plant.vehicle.load_kg=300.0",
}
"""Further change of the scenario by the name of a case."""


def overrides(case: str, start_s: float = START_S) -> list[str]:
    """Return the changes of the scenario for a case; `start_s` [s] where it names no start."""
    keys = CASES[case]
    if "start_s" not in keys:
        keys += f", start_s={start_s}"
    extra = [EXTRAS[case]] if case in EXTRAS else []
    return [*extra, f"faults=[{{{keys}}}]"]
