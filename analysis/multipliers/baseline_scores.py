"""How far two simple methods get on a training set: what a better one has to beat.

Features: once-per-tooth samples, their delay embedding, the spectrum of the cut, the free decay after it, and the
conditions. A softmax regression names the stability class; ridge regressions give the parameters. Both are trained on
the train split, their penalty is chosen on the validation split, and they are scored on conditions held out of both.
Beside each stands the naive answer: the commonest class, or the mean, of the train split. Numpy and scipy only.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import minimize
from scipy.special import logsumexp

from testbed.analysis.multipliers.floquet import delay_embedding_multipliers, once_per_period_samples, passing_period
from testbed.analysis.records.segments import main_channel
from testbed.recording import Recording

FEATURES = ("log spread over teeth per feed", "log growth of the spread", "spread over teeth per rms", "alternation",
            "embedded multiplier: modulus", "embedded multiplier: real part", "embedded multiplier: imaginary part",
            "share of power at tooth harmonics", "share of power between them", "log frequency of the cut's peak",
            "log frequency of the free decay", "log decay rate per frequency", "log spindle speed",
            "log axial depth of cut", "log feed per tooth")
_PHASES, _LEAST = 8, 12
_PENALTIES = (1e-4, 1e-3, 1e-2, 1e-1, 1.0)
MOST_TRAINED = 20_000  # runs; more change the third digit and cost memory


@dataclass(frozen=True)
class ClassifierScore:
    """On one split: rows, groups that are held together, accuracy and the mean recall over the classes present, each with the
    naive answer's; confusion[truth][answer]."""

    split: str
    rows: int
    groups: int
    accuracy: float
    naive_accuracy: float
    recall: float
    naive_recall: float
    confusion: Mapping[str, Mapping[str, int]]


@dataclass(frozen=True)
class RegressorScore:
    """One parameter on one split: rms error and the naive answer's, in its unit; share of variance explained."""

    split: str
    parameter: str
    rows: int
    rms: float
    naive_rms: float
    explained: float


@dataclass(frozen=True)
class Baseline:
    """Scores of both methods, how many rows they were trained on, and why something is missing."""

    trained: int
    classifier: tuple[ClassifierScore, ...]
    regressor: tuple[RegressorScore, ...]
    notes: tuple[str, ...]


def features(recording: Recording) -> np.ndarray:
    """The features (F,) of a recorded cut; NaN where it is too short or broken. Nothing of the truth is looked at."""
    known = recording.conditions
    channel, flutes = main_channel(recording), int(known["flutes"])
    values = np.asarray(recording.channels[channel], float)
    if values.size < 64 or not np.isfinite(values).all():
        return np.full(len(FEATURES), np.nan)
    period = passing_period(recording, float(known["spindle_speed"]), flutes)
    entry = recording.start + int(known["idle_passes"]) * period
    leave = entry + int(known["passes"]) * period
    samples = once_per_period_samples(recording, period, entry, leave, _PHASES, channel)
    if samples.shape[0] < _LEAST:
        return np.full(len(FEATURES), np.nan)
    first, last = (round((time - recording.start) * recording.sampling_rate) for time in (entry, leave))
    scale = float(known["feed_per_tooth"])
    return np.array([*_over_teeth(samples, scale), *_embedded(samples),
                     *_spectrum(values[first:last], 1.0 / period, recording.sampling_rate),
                     *_free_decay(values[last:], recording.sampling_rate, period),
                     math.log(float(known["spindle_speed"])), math.log(float(known["axial_depth_of_cut"])),
                     math.log(scale)])


def _over_teeth(samples: np.ndarray, scale: float) -> tuple[float, ...]:
    half = samples.shape[0] // 2
    early, late = samples[:half], samples[-half:]
    spread, before = (float(np.sqrt(np.mean(part.var(axis=0)))) + 1e-6 * scale for part in (late, early))
    level = float(late.std()) + 1e-6 * scale
    step = late[::2].mean(axis=0) - late[1::2].mean(axis=0)
    return (math.log(spread / scale), math.log(spread / before), spread / level,
            float(np.sqrt(np.mean(step**2))) / (2.0 * spread))


def _embedded(samples: np.ndarray) -> tuple[float, ...]:
    """The strongest multiplier of the delay embedding, truncated to two modes."""
    largest = delay_embedding_multipliers(samples, 2)[0]
    size = min(abs(largest), 3.0)
    angle = math.atan2(abs(largest.imag), largest.real)
    return size, size * math.cos(angle), size * math.sin(angle)


def _spectrum(cut: np.ndarray, tooth: float, rate: float) -> tuple[float, ...]:
    """Shares of the power within 6 % of the tooth frequency of its harmonics, and of the places half-way; the peak."""
    power = np.abs(np.fft.rfft((cut - cut.mean()) * np.hanning(cut.size))) ** 2
    frequency = np.fft.rfftfreq(cut.size, 1.0 / rate)
    order = frequency / tooth
    away = np.abs(order - np.round(order))
    total = float(power.sum()) + 1e-300
    peak = frequency[1 + int(np.argmax(np.where(away > 0.06, power, 0.0)[1:]))]
    return float(power[away <= 0.06].sum()) / total, float(power[away >= 0.44].sum()) / total, math.log(peak / rate)


def _free_decay(rest: np.ndarray, rate: float, period: float) -> tuple[float, float]:
    """Logarithms of frequency over the sampling rate and of decay rate over frequency; a constant where there is none.

    Spectral peak by parabola through three logarithms; decay by the level of successive blocks while it is above twice
    the last one's.
    """
    if rest.size < 8 * period * rate:
        return 0.0, 0.0
    rest = rest - rest[rest.size // 2:].mean()
    spectrum = np.log(np.abs(np.fft.rfft(rest * np.hanning(rest.size))) + 1e-300)
    k = 1 + int(np.argmax(spectrum[1:-1]))
    low, top, high = spectrum[k - 1:k + 2]
    bend = low - 2 * top + high
    bins = k + (0.5 * (low - high) / bend if bend < 0 else 0.0)
    frequency = bins / rest.size  # per sample
    length = max(8, round(4.0 / frequency))
    levels = np.sqrt((rest[:rest.size // length * length].reshape(-1, length) ** 2).mean(axis=1)) + 1e-300
    above = np.nonzero(levels > 2.0 * levels[-1])[0]
    count = int(above[-1]) + 1 if above.size else 0
    if count < 3:
        return math.log(frequency), math.log(1e-6)
    slope = -float(np.polyfit(np.arange(count), np.log(levels[:count]), 1)[0]) / length
    return math.log(frequency), math.log(max(slope / (2 * math.pi * frequency), 1e-6))


@dataclass(frozen=True)
class _Scaled:
    """Features to zero mean and unit deviation on the train split, and their squares."""

    mean: np.ndarray
    deviation: np.ndarray

    def design(self, values: np.ndarray) -> np.ndarray:
        scaled = np.clip((values - self.mean) / self.deviation, -5.0, 5.0)
        return np.column_stack([np.ones(len(scaled)), scaled, scaled**2])


def _scaled(values: np.ndarray) -> _Scaled:
    deviation = values.std(axis=0)
    return _Scaled(values.mean(axis=0), np.where(deviation > 1e-12, deviation, 1.0))


def fit_softmax(design: np.ndarray, target: np.ndarray, classes: int, penalty: float) -> np.ndarray:
    """Weights (columns, classes) of least mean cross-entropy plus penalty/2 |weights|^2; target (rows,) of whole numbers."""
    hot = np.eye(classes)[target]

    def cost(flat: np.ndarray) -> tuple[float, np.ndarray]:
        weights = flat.reshape(design.shape[1], classes)
        score = design @ weights
        total = logsumexp(score, axis=1, keepdims=True)
        slope = design.T @ (np.exp(score - total) - hot) / len(design) + penalty * weights
        return float(np.mean(total[:, 0] - score[hot > 0]) + 0.5 * penalty * np.sum(weights**2)), slope.ravel()

    found = minimize(cost, np.zeros(design.shape[1] * classes), jac=True, method="L-BFGS-B", options={"maxiter": 300})
    return found.x.reshape(design.shape[1], classes)


def fit_ridge(design: np.ndarray, target: np.ndarray, penalty: float) -> np.ndarray:
    """Weights (columns,) of least mean square error plus penalty |weights|^2, the constant left free."""
    free = np.full(design.shape[1], penalty * len(design))
    free[0] = 0.0
    return np.linalg.lstsq(np.vstack([design, np.diag(np.sqrt(free))]),
                           np.concatenate([target, np.zeros(design.shape[1])]), rcond=None)[0]


def baseline(values: np.ndarray, split: Sequence[str], group: Sequence[str], stability: Sequence[str | None],
             parameters: Mapping[str, np.ndarray]) -> Baseline:
    """Train and score both methods.

    values (rows, F): features; split, group, stability: (rows,); parameters: name -> (rows,), NaN where a row has none of that
    name. Rows with broken features are left out.
    """
    whole = np.isfinite(values).all(axis=1)
    where = {name: np.nonzero(whole & (np.asarray(split) == name))[0] for name in ("train", "validation", "test")}
    notes = [f"{np.count_nonzero(~whole)} rows are too short or broken off for the features"] if not whole.all() else []
    notes += [f"no row fell into {name}" for name, rows in where.items() if not len(rows)]
    if len(where["train"]) < 2:
        return Baseline(0, (), (), (*notes, "too few rows to train on"))
    scale = _scaled(values[where["train"]])
    design = {name: scale.design(values[rows]) for name, rows in where.items()}
    classified = _classifier(design, where, group, np.array([each or "" for each in stability]), notes)
    regressed = []
    for name, truth in parameters.items():
        regressed += _regressor(name, design, where, np.asarray(truth, float))
    if parameters and not regressed:
        notes.append("no parameter differs from row to row: none to regress")
    return Baseline(len(where["train"]), tuple(classified), tuple(regressed), tuple(notes))


def _classifier(design: Mapping[str, np.ndarray], where: Mapping[str, np.ndarray], group: Sequence[str],
                stability: np.ndarray, notes: list[str]) -> list[ClassifierScore]:
    known = {name: stability[rows] != "" for name, rows in where.items()}
    train = stability[where["train"]][known["train"]]
    names, counts = np.unique(train, return_counts=True)
    if names.size < 2:
        notes.append(f"the train split holds one class only ({', '.join(names)}): nothing to classify")
        return []
    rows = design["train"][known["train"]]
    target = np.searchsorted(names, train)
    choose = "validation" if known["validation"].any() else "train"
    fits = [fit_softmax(rows, target, names.size, penalty) for penalty in _PENALTIES]

    def answers(weights: np.ndarray, split: str) -> np.ndarray:
        return names[np.argmax(design[split][known[split]] @ weights, axis=1)]

    truth = stability[where[choose]][known[choose]]
    # where two penalties name as many right the larger one is taken: it leans less on the train split
    best = max(range(len(fits)), key=lambda k: (float(np.mean(answers(fits[k], choose) == truth)), k))
    common = str(names[np.argmax(counts)])
    scores = []
    for split, places in where.items():
        told = stability[places][known[split]]
        if told.size:
            groups = len({group[place] for place in places[known[split]]})
            scores.append(_classified(split, groups, told, answers(fits[best], split), common))
    return scores


def _classified(split: str, groups: int, truth: np.ndarray, answer: np.ndarray, common: str) -> ClassifierScore:
    present = sorted(set(truth.tolist()))
    confusion = {one: {other: int(np.count_nonzero((truth == one) & (answer == other)))
                       for other in sorted(set(present) | set(answer.tolist()))} for one in present}
    recall = float(np.mean([np.mean(answer[truth == one] == one) for one in present]))
    return ClassifierScore(split, truth.size, groups, float(np.mean(answer == truth)), float(np.mean(truth == common)), recall,
                           float(common in present) / len(present), confusion)


def _regressor(name: str, design: Mapping[str, np.ndarray], where: Mapping[str, np.ndarray],
               truth: np.ndarray) -> list[RegressorScore]:
    has = {split: np.isfinite(truth[rows]) for split, rows in where.items()}
    train = truth[where["train"]][has["train"]]
    if train.size < 3 or np.ptp(train) <= 1e-9 * float(np.abs(train).max()):
        return []
    mean, deviation = float(train.mean()), float(train.std())
    choose = "validation" if has["validation"].any() else "train"

    def errors(weights: np.ndarray, split: str) -> np.ndarray:
        return design[split][has[split]] @ weights * deviation + mean - truth[where[split]][has[split]]

    fits = [fit_ridge(design["train"][has["train"]], (train - mean) / deviation, penalty) for penalty in _PENALTIES]
    best = min(fits, key=lambda weights: float(np.mean(errors(weights, choose) ** 2)))
    scores = []
    for split, rows in where.items():
        told = truth[rows][has[split]]
        if told.size:
            rms, naive = (float(np.sqrt(np.mean(error**2))) for error in (errors(best, split), mean - told))
            scores.append(RegressorScore(split, name, told.size, rms, naive, 1.0 - (rms / naive) ** 2 if naive else math.nan))
    return scores


def as_json(found: Baseline, names: Sequence[str] = FEATURES) -> dict[str, Any]:
    """Plain values of the scores; names: of the features."""
    return {"trained_on_rows": found.trained, "features": list(names),
            "classifier": [vars(each) for each in found.classifier],
            "regressor": [{**vars(each), "explained": None if math.isnan(each.explained) else each.explained}
                          for each in found.regressor], "notes": list(found.notes)}
