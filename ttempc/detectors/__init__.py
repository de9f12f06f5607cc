"""Detectors of faults: one function each, one table of limits and reactions, one loop of alarms.

- `interface`: what a detector is, also one of a user's; reactions of the supervisor.
- `table`: name, limit, reaction, excluded sensors and words of each built-in detector.
- `readings`, `motion`, `steering`, `innovations`, `hitch`, `position`, `drift`: the detectors. Each
  is a function, `observe_drift` and so on, that writes its statistic to the board; its memory is a
  record of its own.
- `speeds`, `valve`, `standstill`: what they compare, in records of their own.
- `history`: histories, medians and cumulative sums for all of them.
- `board`: statistics and alarms of all; begin and end of an alarm. `exclusion`: of sensors.
- `kernel`: a tick of all, in order. `monitors`: its edge to Python, and detectors of a user.
"""
