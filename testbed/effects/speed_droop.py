"""Speed droop: the spindle slows under load, with a time constant.

    n = n0 (1 - s),    T ds/dt = d M - s

s is the relative loss of speed, M the spindle's torque (its course within a tooth pass is smoothed by T), d the droop of
the drive and T the time constant of its speed control.
Source: W. Leonhard (2001), Control of Electrical Drives, 3rd ed., Springer, chapter 7 (a drive under proportional
control, and an induction motor's slip, give way in proportion to the torque, with one time constant).

Valid for a loss of speed well below 1 (it is held between -0.5 and 0.9) and a time constant above a few tooth passes.
At a steady load the speed approaches n0 (1 - d M) as exp(-t / T), M then being the mean over a tooth pass.

With a tachometer the measured angle drives the model, and the effect is seen, not hidden.
Start of a fit: d from the change of tooth passing frequency between idling and cutting over the mean torque.
"""

from testbed.effect import Effect, Parameter

EFFECT = Effect(
    title="Spindle speed falling under load",
    parameters=(
        Parameter("droop", "d", "1/(N m)", "relative loss of speed per torque at the spindle",
                  neutral=0.0, bounds=(0.0, 5.0), example=0.25, start=0.02),
        Parameter("time_constant", "T", "s", "time in which the drive gives way by 63 %",
                  neutral=0.2, bounds=(0.005, 20.0), example=0.2, start=0.2, vanishes=False),
    ),
    law="n = n_0 (1 - s), T ds/dt = d M - s; s: relative loss of speed, M: torque at the spindle",
    source="Leonhard (2001), Control of Electrical Drives, 3rd ed., chapter 7",
    validity="loss of speed well below 1, time constant above a few tooth passes",
    leaves="tooth passing that falls behind the nominal speed after the entry; lobes at the wrong speed",
    confused_with=(
        ("speed_variation", "a long cut: droop settles and grows with depth of cut, variation goes on and does not"),
        ("immersion_error", "the tachometer, or the tooth passing frequency: only droop moves it"),
    ),
    states=("loss",),
)


def derivative_loss(torque, loss, droop, time_constant):
    return (droop * torque - loss) / time_constant


def speed(loss):
    return -min(0.9, max(-0.5, loss))
