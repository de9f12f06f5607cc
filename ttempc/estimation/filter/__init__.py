"""Extended Kalman filter over the augmented state; compiled.

States x (`ttempc.models.augmented_state.AugmentedState`), map frame:

    name                    unit    meaning
    X, Y                    m       tractor point
    PSI_T, PSI_I            rad     yaw of tractor and trailer
    DELTA_T, DELTA_I        rad     steering angle of the front wheels, and of RJ2
    WHEEL_SPEED             m/s     circumferential speed of the driven wheels
    SLIP_T, SLIP_I          rad     side slips that turn with the vehicle
    STEERING                rad     added to the measured front steering angle
    DRIVE                   m/s^2   acceleration of the wheels, added to the hydrostat's
    WHEEL                   1       wheel slip that turns with the vehicle
    SIDE_X, SIDE_Y          rad     side slip of both axles on a slope: a vector fixed in the map
    CLIMB_X, CLIMB_Y        1       wheel slip on a slope: a vector fixed in the map
    GNSS_X, GNSS_Y          m       half the slow error of the trailer's receiver less the tractor's
    OFFSET_I, OFFSET_HITCH  rad     offsets of two sensors of angles
    GYRO_T, GYRO_I          rad/s   biases of the gyros
    PAST_T, PAST_I          rad     yaws at the last sample of each gyro

The first 7 (`STATES`) follow the vehicle's equations, the other 17 fade. With the command u, the
process noise Q, a reading y of covariance R and its equation h:

    predict   x <- f(x, u),  P <- Phi (P + Q/2) Phi' + Q/2,  Phi = df/dx = [[A, B], [0, F]]
    correct   nu = y - h(x),  S = H P H' + R,  H = dh/dx,  x <- x + P H' S^-1 nu,
              P <- P - P H' S^-1 H P

A is 7 x 7, B 7 x 17, F diagonal. Three factors of the variances in Q (`NoiseScale`) are learnt from
the likelihood of nu, for which x and P have derivatives by the factors. Of arrays (4, ...) the
first entry, a level, is the value, the others are these derivatives. Rows are 24 numbers wide.

    records    FILTER (constants), SNAPSHOT (all that is carried on), and their making
    start      first snapshot, from one reading of every sensor
    predict    from one time to the next under the commands that act meanwhile
    correct    by a reading
    sample     from a sample to a reading: antennas, gyros, gate, patience
    history    ring of snapshots, buffer of samples, commands: samples may come late
    observe    a tick: samples in, estimate out
"""
