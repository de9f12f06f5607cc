"""MuJoCo by the addresses of its functions and variables: all that depends on its inside.

`compiled_steps` takes the physics steps of soil wheels without Python in between. Its parts below
know more of MuJoCo than its documented interface. The project file therefore allows one minor
version only, and the first plant of a process takes four steps both ways (`self_check`): where they
differ by more than 1e-9, one line is logged and every plant of the process takes plain steps.

    module     what it relies on              when the library changes      how one sees it
    ---------  -----------------------------  ----------------------------  ------------------------
    library    names and arguments of eleven  a name is gone                plain steps and a line
               functions of libmujoco         other arguments               the process ends, or the
                                                                            self-check fails
    library    `mjcb_time`, the clock that    it is gone                    plain steps and a line
               MuJoCo reads 20 times a step
    library    `disableflags` after           other order in `mjOption`     plain steps and a line
               `o_friction` in `mjOption`
    motion     order of the functions in      another stage in a step, or   self-check,
               `mj_step`; sums of forces,     another sum                   test_compiled_steps
               of `implicitfast`
    contacts,  a step without contacts and    another source of             test_compiled_steps,
    clearance  limits has no constraint       constraints                   self-check in part

To switch all of it off: `TTEMPC_PLAIN=1` in the environment. Steps are then those of `mj_step2` and
`mj_step1`, called from Python (`plain_steps`), as they are under `NUMBA_DISABLE_JIT=1`; the physics
takes about three times as long.

An error inside MuJoCo, such as a lack of memory for its stack, ends the process here, because no
Python stands between. A state that is not finite is found when the call has ended.
"""
