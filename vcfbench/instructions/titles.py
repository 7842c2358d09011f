"""Built-in procedures by name, with their titles; each is the module or the folder of its name."""

BUILT_IN = {
    "turntable": "Calibrate on the rate table, generator off.",
    "virtual-coriolis": "Calibrate by the paper's four steps: on the rate table and by the virtual Coriolis force.",
    "zero": "Record the output at rest: Allan deviation, noise coefficients, bias stability.",
    "kvc": "Calibrate K_Vc as a curve on the rate table, V_Vc measured: the certificate of a device.",
    "warmup": "Follow the output at rest from power-on until it is steady: turn-on and warm-up time.",
    "bandwidth": "Measure the response to a sine on V_Vc: mode split, Q of the sense mode, +3 dB, peak, -3 dB.",
    "power": "Test the supply: inrush, current of each rail, time to valid output, effect of the rails on the output.",
    "repeatability": "Switch on and off again and again: repeatability of bias and scale factor, turn-on transient.",
    "rate-limits": "Raise the rate until the output falls short: input rate limits of both signs, the output beyond.",
    "resonance": "Measure frequency and Q of drive and sense modes and the mode split, by ring-down and by sweep.",
    "phase": "Measure the phases of carrier, Coriolis and virtual signal and demodulator, and their effect on K_Vc.",
    "temperature": (
        "Follow scale factor, bias and drive frequency over temperature, up and down: coefficients and hysteresis."
    ),
    "self-calibration": (
        "Recalibrate without a table: scale factor, bias and linearity from V_Vc, by the device's certificate."
    ),
    "electrical": "Before power: the resistance of each line by the multimeter, against limits.",
    "polarity": "Check the signs of table, V_Vc and output: find a reversed wire.",
    "threshold": "Step V_Vc or the table in ever smaller steps: threshold, resolution and dead band.",
    "g-sensitivity": "Turn the case by hand, each axis up and down: bias against acceleration.",
    "axes": "Mount the case by each axis on the table: sensitivity to a rate about each axis, angle of the input axis.",
    "vibration": "Add a virtual vibration by the second generator: response of the output against the closed form.",
    "online": "Recalibrate while the gyroscope measures: lock-in of a sine on V_Vc, scale factor over time.",
    "characterize": "Run all procedures in the right order, in one session: one data sheet.",
}
