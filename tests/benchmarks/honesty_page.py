"""The words of docs/honesty.md: what is proved, what is measured, and what is not covered."""

TITLE = """# Are the claimed errors true?

Written by `python -m tests.benchmarks.honesty`; version {version}, numerics {numerics}.
"""

PROVED = """## What is proved

A statement of this section is about whole intervals, not about nodes: it follows from enclosures that
contain every value of a function on the interval. It holds unless the program, or what it rests on
(flint, the arithmetic of the processor), has a mistake.

* **Verdicts.** `admissible`: the compatibility equation holds identically, by exact algebra, on every
  piece of the sphere on which the formula is analytic, and V and the energy are the same on both sides of
  every kink that curves cross. `inadmissible`: a point, or a line that curves cross, with an enclosure
  that excludes 0. Everything else is `undecided`.
* **Windows.** How many there are, of what kind, and where they end: every cell of the loop has p² of one
  certain sign, or a slope of p² of one certain sign, or is about a zero that is treated by name. What
  cannot be settled is refused (`signs_unsettled`). A double zero is proved to be one (`separatrix`), or
  its gap is reported; else it is refused (`separatrix_undecided`). Seen only, on a stretch of at most 1e-5 of
  its distance to the pole: that a zero of order 3 and more of which
  exact algebra does not find, or of no order, has no others beside it. What
  p² does at a pole itself follows from its power next to it.
* **The time map of the compiled solvers** of a formula with functions, quotients or high powers: what the
  series leave out is bounded by one disc about each panel. Not that of a sum of low powers, see below.
* **The time map and the period of the quadrature in balls**, where the potential has a formula: what the
  series leave out is bounded on an ellipse about every panel. Where nothing can be enclosed, the whole
  length of the panel counts as error (`unproved_panels` in the evidence), and so do panels next to a
  place where the motion all but comes to rest.
* **Everything in the tier `certified`** that has a radius, and samples that are rounded enclosures in the
  other tiers (`proven_samples` in the evidence).
* **Multipliers and trusted times**, where `error_kind` says so. A trusted time is a statement about the
  equations of variation, the equations of motion to first order: a rounding at the beginning of every period
  stays below the tolerance until then. It says nothing of what an integrator loses in its steps.
"""

MEASURED = """## What is measured

* **The function of time** in the tiers `draft`, `standard` and `high`, hence `error` and the samples. It is
  compared with the time map between its nodes, and checked against the equations and the integrals of motion
  on whole pieces (`defect` in the evidence; `defect_covers` is the share of the time for which that bound
  is a theorem). A claim that these contradict is raised. That is no proof: a defect does not show how
  far errors grow.
* **Roundings in the compiled solvers** (`draft`, `standard`, `high`) are bounded operation by operation; that
  none was forgotten is not proved.
* **What series leave out in the compiled solvers where V is a sum of powers up to degree 12** (in `draft`,
  `standard` and sweeps): three times the largest departure from the formula, seen at four places of each
  panel where it is largest if what follows the series is smooth. No feature of such a V is narrower than
  the sphere over its degree. The bounds that prove it would cost several times the solver.
* **The kernel of `high` for such sums** (any A/C, without exact roots): what harmonics of the rate leave out
  of the period is estimated from how the last ones fall, with half the decades that they fall counted; each
  panel is compared with the formula, with twice the digits, at one point, and four times the largest
  departure counts.
* **How fast variables change**, by which an error of a time becomes one of a sample: from differences of
  neighbouring points, eight in a panel, enlarged by a quarter. Each panel has its own.
* **Potentials given by an integral** in the tiers `draft`, `standard` and `high`: windows are those of a
  scan, and panels are judged by the decay of their series. Along the motion V₁ is a series of integrals, to
  80 bits by the decay of its terms and by what is seen between its nodes. In the tier `certified` it is
  proven, and that rest points are the only ones on the way; which window is the first of the scan is not.
* **Samples beside a pole that nothing encloses** (V₁ as an integral, logarithms below A/C = 2): twice what
  moving a time by its error does to the variables, and four times the largest departure that was seen in its
  panel of the phase.
* **The method `integration`**, and with it cross-checks and motions from any state. The error has two parts.
  One is the difference of runs (of four in compiled code, else of two; or the error that follows from what
  the finer run leaves of the equations, `error_by_residual` in the evidence, if that is larger). The other is
  what the errors of all steps have grown to at a later time (`grown_errors`), checked against the equations:
  they grow by the equations of variation along the motion, and the error of one step is modelled, as the
  rounding of everything that is added up in it and what its series leave out. Both parts are estimates, to
  first order. So are the errors of the attitude: what its linear equations are missed by, and the roundings,
  propagated by these equations, and enlarged by the factor by which the claimed error of the variables
  exceeds the same estimate of them.

Hence the runs below. **A claim is exceeded if the true number is proven to be further away than it.** That
none was exceeded in a run is said of its problems, and of no others.
"""

NOT_COVERED = """## What is not covered

* By no reference here: potentials given by an integral; attitude and multipliers of other planar motions than
  those with three terms; of smooth potentials aperiodic motions, and those that pass a pole at which V has a
  logarithm; motions from any state beyond t = 60, and fields that are no sums of powers.
* Of hostile potentials those that are not admissible are judged by their verdicts alone, as are motions
  into a collision at a pole by their windows alone. Admissible features are functions of g2 times
  A g1² + C g3², and kinks on curves; there is none in F(w) but these.
* Widths below 1e-8, more than two features at once, and times beyond {latest:.0f} periods ({rounds} of
  hostile problems).
* Motions of potentials that are undecided (`"accept": "undecided"`): only what is proved is asked for.
"""

PASSAGES = """## Motions through poles

The first {done} problems of the seed {seed}, in {minutes:.0f} minutes, numerics {numerics}: motions that pass
g1 = g3 = 0, with A/C or C/A between 1.01 and 100, of |g1| to the power that keeps p constant, of the first
three homogeneous terms, and of the rational terms up to a_2 and c_2; the rest is as above. Next to a pole
that is passed without smoothness the function of time has a wide claim of its own, since variables grow there
like a root of the time; samples are then rounded enclosures, which claim what they miss; they are of 64 bits.
The reference has {bits}, made anew; times go up to {latest:.0f} periods, and starts are as near to an end as
1e{smallest:.0f}. Seconds of the processor are those of an answer, in one process that remembers the way
through the poles. Refused here are motions on steep curves, with A/C or C/A above 50. They are answered
since: of the first 980 of these problems, asked once more, none was refused, and no claim exceeded. Those
with an invalid document ask for a term that the family has not.

| tier | family | asked | solved | refused | exceeded | smallest | median | seconds |
| --- | --- | --- | --- | --- | --- | --- | --- | --- |"""
"""Its section about motions through poles, up to the rows of the table."""

SMOOTH = """## Smooth potentials

The first {done} problems of the seed {seed}, in {minutes:.0f} minutes, numerics {numerics}. Every problem is
solved in each tier the way the service does it, and compared with the certified motion in balls of
{bits} bits. Bodies, coefficients, curves, windows, starts and signs are random; gaps to separatrices, to
the equator and to the pole go down to 1e{smallest:.0f}; the times are 0, some within one period and some up
to {latest:.0f} periods, one in five times backwards. Smallest is the least claimed/actual of the samples,
median the power of ten in which its median lies. Samples that are rounded enclosures claim what they miss, a
ratio of 1; they are of 64 bits, and the reference is made anew in 128. The verdict is not asked: all
potentials are admissible by their making.

| tier | family | asked | solved | refused | exceeded | smallest | median | seconds |
| --- | --- | --- | --- | --- | --- | --- | --- | --- |"""

STATES = """## Motions from states next to unstable ones

The first {done} motions of the seed {seed}, in {minutes:.0f} minutes, numerics {numerics}. Free bodies begin
next to a rotation about their middle axis, heavy tops next to the upright one (at rest, or spinning), bodies
in quadratic and cubic fields next to any equilibrium or permanent rotation on an axis; the gaps go down to
1e{narrowest:.0f}. There are up to {passages:.0f} passages, and times up to {latest:.0f}; one in five goes
backwards. Whoever passes an unstable motion, leaves it and passes it again multiplies what was lost on the
way. References are power series in twice the digits (`tests/support/doubled_series.py`), from the exact
state. Smallest and median as above.

| tier | kind | asked | solved | refused | exceeded | smallest | median | seconds |
| --- | --- | --- | --- | --- | --- | --- | --- | --- |"""

MOTIONS = """## Motions of every sort, attitudes and multipliers

The first {done} motions of the seed {seed}, in {minutes:.0f} minutes at low priority beside other work,
numerics {numerics}. Chaotic: any body in a field with linear, quadratic and cubic terms, from any state, up
to t = {latest:.0f}. Near upright: tops of any spin up to twice the critical one, from 1e-6 of the vertical
on. Fast spin: up to {fastest:.0e}, for {radians:.0f} radians. Nearly singular: a wall of the size
1e-6 to 0.1 over a power of one γ, which the motion runs against. Moments nearly equal to 1e-12, or apart by
up to 1e6. Planar: the attitude of motions with three terms, over two periods. Classical: all cases, with
random bodies and phases. All of these with their attitude: the smaller bounds of ω and γ, of the quaternion
and of each angle are compared one by one. Multipliers: of planar motions with three terms and any B between
the triangle inequalities. References are series in twice the digits (`tests/support/doubled_series.py`),
for attitudes with q' = q ω / 2, for multipliers with the equations of variation of all six variables, from
the exact state, or a proven one of 150 bits; of the classical cases from the state that the service places.
Samples are those of a job, documents and all; what takes more than 10 s of processor time is stopped.

| tier | kind | asked | solved | refused | exceeded | smallest | median | seconds |
| --- | --- | --- | --- | --- | --- | --- | --- | --- |"""
