"""Content of diagnosis.json, key by key; the page of file formats is made from it.

Numbers have six significant digits; null stands for a value that is not known. low and high bound 95 %.
"""

from __future__ import annotations

from typing import Literal, NotRequired, TypedDict

from evaluator.diagnosis.assessment.verdict import Verdict
from evaluator.diagnosis.mistakes.recognised import Kind

Number = float | None


class Bounded(TypedDict):
    """A value with its 95 % interval."""

    value: Number
    low: Number
    high: Number


class MistakeContent(TypedDict):
    """A mistake in the files or an incident in the recording; its runs are excluded from everything else."""

    runs: list[str]  # ids of the runs
    kind: Kind  # the most probable kind
    equivalent_kinds: list[Kind]  # other kinds that the motion of these runs cannot distinguish from it
    sentence: str  # what is wrong, for people


class TermContent(TypedDict):
    """One term of a free-form effect: coefficient times basis, acting on a channel (`turnscope effects free-form`)."""

    channel: str  # where it acts; if the effect is not fitted: the quantity that disagrees
    basis: str  # quantity that it is proportional to
    pattern: NotRequired[str]  # weights over the wheels
    parity: NotRequired[str | None]  # see where; only if the effect is not fitted
    coefficients: NotRequired[list[Bounded]]  # only if the effect is not fitted


class DeterminedContent(Bounded):
    """A quantity with the value according to robot.toml."""

    stated: Number


class EffectContent(TypedDict):
    """An effect of the verdict. For `"unknown"`, id is `"free-form"`: the effect is described by its terms."""

    id: str  # as in [[effect]] of robot.toml, or "free-form"
    name: str  # in words
    parameters: dict[str, Bounded]  # by name; intervals allow for a further effect that gains too little to be named
    determined: NotRequired[dict[str, DeterminedContent]]  # what the runs show even if not the parameters, by name
    equivalent: list[str]  # ids of effects that these runs cannot distinguish from it, most similar first
    probability: float  # that the effect is present, given the runs and all sets of effects that were compared
    terms: NotRequired[list[TermContent]]  # of a free-form effect
    fitted: NotRequired[bool]  # false: no term was fitted; parameters are the RMS disagreement by quantity


class ChangesContent(TypedDict):
    """The largest change that an effect causes in any run."""

    path_noise_floors: float  # RMS change of the path over the noise floor
    radius_percent: float  # of the turning radius
    speed_percent: float  # of the speed


class NegligibleContent(TypedDict):
    """An effect that is significant but below all limits of [relevant] in experiment.toml."""

    id: str
    parameters: dict[str, Bounded]
    changes: ChangesContent


class KnownToContent(TypedDict):
    """A quantity that the laboratory knows to a tolerance ([known_to]), and its deviation according to the runs."""

    quantity: str  # key
    name: str  # in words
    unit: str  # of the numbers below; "1": relative
    taken: Number  # tolerance, 1 sigma
    found: Number  # deviation of the true value from the stated one
    low: Number
    high: Number
    equivalent: list[str]  # ids of effects that would have the same consequence
    from_run: NotRequired[str]  # of a change of the value within the session: the first run after it


class KnownTogetherContent(TypedDict):
    """Joint test of all deviations in known_to against their tolerances."""

    square: Number  # sum of squares of the deviations over their tolerances
    freedom: int  # degrees of freedom: combinations of the quantities that the runs determine
    probability: Number  # of a square this large by chance (chi-square)
    sentence: str | None  # the finding in words; null if chance explains the deviations


class PairContent(TypedDict):
    """RMS over the fitted and over the held-out runs."""

    fit: Number
    held_out: Number


class PredictedContent(TypedDict):
    """Gap when a run is simulated from its start pose alone, without fitted random effects."""

    before: PairContent
    after: PairContent


class RunGapContent(TypedDict):
    """Gap of one run."""

    before: Number
    after: Number
    noise_floor: Number


class GapContent(TypedDict):
    """RMS distance between measured and simulated marks, after start pose and random effects of each run are fitted."""

    unit: Literal["mm"]
    held_out_runs: list[str]  # runs not used for the choice and the size of the effects behind this gap
    before: (
        PairContent  # with the robot file, and the values common to all runs that the session has (start, clock, ...)
    )
    after: PairContent  # with the effects found
    predicted: PredictedContent
    not_predicted: dict[str, str]  # by run: why its prediction from the start pose counts in no RMS
    elsewhere: list[str]  # runs on open ground that neither model follows, as after another turn: in no RMS
    diverging: list[str]  # runs whose noise floor is ten times the median and more: in no RMS
    noise_floor: Number  # gap that noise alone causes
    held_out_gain_sigmas: Number  # significance of the better prediction of the held-out runs; null if none is held out
    by_run: dict[str, RunGapContent]  # by run


class WhereContent(TypedDict):
    """A dependence of the disagreement with the robot file, before any effect is added."""

    quantity: str  # "along", "sideways": components of velocity in the robot's frame; or "yaw_rate"
    by: str  # same as depends_on
    depends_on: str  # what the disagreement depends on, in words, such as "speed" or "heading"
    parity: str | None  # "even" or "odd": sign when the motion, or for yaw_rate the side, is reversed
    runs: list[str]  # runs that disagree in this quantity
    size: Number  # of the dependence, in unit
    unit: str
    sigmas: Number  # significance
    after_sigmas: Number  # significance in the residuals of the chosen model
    sentence: str  # in words


class DisagreesContent(TypedDict):
    """A phase of a run that disagrees with the robot file."""

    run: str
    phase: str  # "start": the first second after the motors come on; "steady": the rest
    quantity: str  # as in where
    size: Number  # measured minus predicted, mean over the phase, mm/s or deg/s
    sigmas: Number  # relative to the residuals of the chosen model


class LimitContent(TypedDict):
    """Interval (95 %) of a parameter of an effect that is not among `effects`, if it acted beside these."""

    id: str
    parameter: str
    low: Number  # null: smaller values are impossible, and 95 % are below high
    high: Number  # null: the effect is absent at infinity, and 95 % are above low


class RivalContent(TypedDict):
    """Another set of effects that was compared, most probable first."""

    effects: list[str]  # ids; empty: no effect
    probability: float
    log_odds: Number  # natural logarithm of its odds relative to the chosen set, with priors
    reason: str  # why it was not chosen
    strains: list[str]  # quantities that it moves beyond their tolerances
    carries_over: bool | None  # open ground: whether its effects hold for commands that were left out; else null


class NextRunContent(TypedDict):
    """A run to record."""

    left_rpm: float
    right_rpm: float
    x_mm: float  # start pose in the plate frame
    y_mm: float
    heading_deg: float
    duration_s: float
    times: int  # number of repetitions


class NextExperimentContent(TypedDict):
    """Runs that would distinguish the chosen effects from the alternatives."""

    runs: list[NextRunContent]
    separation_sigmas: dict[str, Number]  # by alternative: its distance after these runs, with the present ones
    most_runs: int  # largest number of runs that was considered
    inseparable_sigmas: dict[str, Number]  # by alternative that even most_runs runs would not exclude


class UnlikeRunsContent(TypedDict):
    """Runs that the model explains, but with friction or wheel speeds unlike those of other runs, or of runs before."""

    runs: list[str]
    quantity: str  # "friction", "left_gain" or "right_gain" (speed of the wheels of a side)
    relative_change: Number  # relative to the other runs, or to the runs before
    sentence: str  # in words


class RunToRunContent(TypedDict):
    """Scatter from run to run, relative, 1 sigma."""

    friction: Number
    friction_95: list[Number]  # its 95 % interval
    wheel_speed: Number
    wheel_speed_95: list[Number]
    commands_rounded_to_rpm: NotRequired[float]  # step of all commands, if rounding to it explains wheel_speed


class NoiseContent(TypedDict):
    """Noise of the measurement as estimated from the runs."""

    mark_sigma_mm: Number  # of a coordinate of one mark, 1 sigma, median over the runs
    common_drift_mm: Number  # slow common motion of all marks relative to the plate, RMS about its mean over a run
    friction_in_10_mm: Number  # random change of friction over 10 mm of path, relative, 1 sigma
    correlation_s: Number  # time over which the noise of the marks is correlated
    smoothed: bool  # whether tracks are smoothed, so that frames near changes of the command are not used
    smoothed_over_frames: int  # width of the window; 0 of raw tracks
    run_to_run: RunToRunContent | None  # null on open ground, where it is part of the noise


class NominalContent(TypedDict):
    """Adjustment of a nominal value of robot.toml within its [tolerance]; relative."""

    relative_change: Number
    sigma: Number  # standard uncertainty of relative_change
    tolerance: float  # 1 sigma


class DiagnosisContent(TypedDict):
    """The verdict with its evidence. Keys from `known_together` on exist only if a model was fitted.

    explained_mistakes, stopped, own_effects and changed_meanwhile: only if there are any.
    """

    format: Literal[1]
    verdict: Verdict  # the model explains the runs; known effects do; neither does; the runs cannot decide
    reason: str  # for the verdict, in a sentence
    mistakes: list[MistakeContent]
    effects: list[EffectContent]  # found
    gap: GapContent | None  # between simulation and measurement
    negligible: list[NegligibleContent]  # effects found that are not relevant
    known_to: list[KnownToContent]
    where: list[WhereContent]
    disagrees: list[DisagreesContent]
    rivals: list[RivalContent]
    next_experiment: NextExperimentContent | None
    left_out_runs: dict[str, str]  # usable runs that were not used, with the reason
    skipped_runs: dict[str, str]  # runs that cannot be used, with the reason
    explained_mistakes: NotRequired[list[MistakeContent]]  # that the effects explain; their runs are left out
    stopped: NotRequired[bool]  # whether the search reached its limit of time before a decision
    known_together: NotRequired[KnownTogetherContent | None]
    findings: NotRequired[list[str]]  # deviations in known_to and nominal beyond three tolerances, in words
    constancy: NotRequired[dict[str, Number]]  # by split of the runs: probability that both halves have equal effects
    runs_not_followed: NotRequired[list[str]]  # outlying runs, which the chosen model does not explain
    unlike_runs: NotRequired[list[UnlikeRunsContent]]
    noise: NotRequired[NoiseContent]
    nominal: NotRequired[dict[str, NominalContent]]  # by dotted key of robot.toml
    shared_errors_sigmas: NotRequired[dict[str, Number] | None]  # fitted errors common to all runs, over their sigmas
    limits: NotRequired[list[LimitContent]]  # with "none" and "effect": what the runs exclude
    not_tried: NotRequired[list[str]]  # effects that these runs cannot show: of the plate, or from run to run
    not_driven: NotRequired[list[str]]  # kinds of motion that no run has: "left turns", "backward motion"
    exact_frictions: NotRequired[list[str]]  # without a tolerance, of which sizes of the found effects depend
    own_effects: NotRequired[dict[str, str]]  # effects of the user that were tried: file by id
    changed_meanwhile: NotRequired[list[str]]  # input files that changed during the diagnosis
