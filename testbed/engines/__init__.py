"""Two engines that share the law of the cut and nothing else: `fast`, compiled, and `mujoco_engine`, the reference.

Glossary of the kernels' arrays. The kernels are compiled by numba and take plain arrays; each array has one letter everywhere,
and each of its places a constant with a name. `packing` makes them of a model and a cut. SI throughout.

| array   | shape               | holds                                                                | its places in        |
|---------|---------------------|----------------------------------------------------------------------|----------------------|
| A       | effects             | 1 where the model has the effect, else 0                             | `compose.Layout`     |
| P       | parameters          | all effects' parameters; behind them the modes in x and y            | `compose.Layout` |
| G       | G_SIZE              | geometry and conditions: angles, depth, feed, speed, coefficients    | `loop_kernel`        |
| I       | settings            | whole numbers: passes, segments, steps and teeth of each segment     | `fast_kernel`        |
| O       | oscillators, 3      | what is carried exactly: place in Y, pull (1/s^2), drag (1/s)        | `oscillator_kernel`  |
| V       | teeth, 2            | of unequal pitch: where each tooth enters, by how much it follows    | `turn_kernel`        |
| Y       | states              | [q, q', t, effects' states, further modes' q and q']                 | `hooks`              |
| D, W, K | as Y                | the slope of Y; a stage's state; what the stages of a step add       | `fast_kernel.advance`|
| T       | rows, edges, T_SIZE | what depends on the angle alone: cover, travel, theta, sine, cosine  | `loop_kernel`        |
| S       | rows, edges         | the surface: radial position (m) left one tooth pass before          | `loop_kernel`        |
| M       | rows, edges         | of unequal pitch: what each edge left, for the tooth that follows    | `uneven_kernel`      |
| H, E    | oscillators, 4      | exact maps of O over half a step, and over a whole one               | `oscillator_kernel`  |
| maps    | segments + 1, 2, oscillators, 4 | H and E of every segment; the last is for flights        | `fast_kernel`        |
| work    | 11, states          | Y, Y at the step's end, D at both, and what `advance` needs          | `fast_kernel.advance`|
| left    | 4, edges            | what the edges leave at a step's start, end, middle, and at a sample | `fast_kernel`        |
| tooth   | edges               | which tooth an edge belongs to                                       | `fast_kernel`        |
| modes   | modes, MODE_SIZE    | of a machine in the plane: direction, mass, damping, stiffness, part | `plane_kernel`       |
| Q       | modes, 2            | their coordinates and rates, where nothing else is a state           | `modes_kernel`       |
| bench   | six arrays          | of a step in the cut: kappa, memory; or T, S, left, tooth, Y, ends   | `plane_run_kernel`   |
| kappa   | rows, 1, 4          | of base models: the force under a chip, along and across             | `plane_linear_kernel`|
| memory  | rows, 2             | of base models: where the tool was one tooth pass before             | `plane_linear_kernel`|
| clock   | 2, or 2 + channels  | time of the first sample (s), sampling rate (Hz); what is asked for  | `sampling_kernel`    |
| out     | channels, samples   | the record; NaN before the structure is let go and after a divergence | `sampling_kernel`   |

Row 2k of a table is the end of step k, row 2k + 1 the middle of the step that follows.
"""
