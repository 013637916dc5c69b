"""Distribution of dark counts over the pixels of an array, fitted to a measured map.

The density of `DarkCounts` is that of ordinary pixels, a normal one cut off at zero, and of hot
ones, log-normal. Its five parameters maximize the likelihood of the pixels, which are taken as
independent, from the best of some starts.
"""

from itertools import product
from typing import Any

import numpy as np
from scipy.optimize import minimize
from scipy.special import log_ndtr, ndtr

from megalopta.core.arrays import Floats
from megalopta.sensor.effects.dark_counts import DarkCounts

_FEWEST, _MOST = 12, 4096
"""Pixels that are needed, and ranks of the pixels that are used."""
_STARTS = (0.1, 0.5), (0.2, 0.8), (0.05, 0.4)
"""Quantile at which ordinary pixels are, their relative standard deviation, share of hot ones"""
_EXPONENT = 30.0
_SEARCH: Any = {"maxiter": 2000, "xatol": 1e-3, "fatol": 1e-3}


def fit_dark_counts(rates: Floats) -> DarkCounts:
    """Return the distribution, per unit of area, of rates in any shape.

    Raises ValueError if there are too few pixels, or rates are negative.
    """
    known = rates[np.isfinite(rates)]
    if known.size < _FEWEST or known.min() < 0 or not known.any():
        raise ValueError(f"{known.size} rates; give {_FEWEST} or more, not negative and not all 0")
    scale = float(np.median(known)) or float(known.mean())
    ordered = np.sort(known)[:: -(-known.size // _MOST)] / scale

    def start(quantile: float, spread: float, hot: float) -> list[float]:
        tail = np.log(np.maximum(ordered[-max(int(hot * ordered.size), 3) :], 1e-3))
        middle = max(float(np.quantile(ordered, quantile)), 0.1)
        return [
            middle,
            np.log(spread * middle),
            np.log(hot / (1 - hot)),
            tail.mean(),
            np.log(tail.std() + 0.3),
        ]

    def loss(parameters: Floats) -> float:
        return -_log_likelihood(ordered, parameters)

    fits = [
        minimize(loss, np.array(start(*choice)), method="Nelder-Mead", options=_SEARCH)
        for choice in product(*_STARTS)
    ]
    return _parameters(min(fits, key=lambda each: float(each.fun)).x, scale)


def _log_likelihood(rates: Floats, parameters: Floats) -> float:
    mean, log_sigma, logit, log_hot, log_spread = np.clip(parameters, -_EXPONENT, _EXPONENT)
    sigma, spread = np.exp(log_sigma), np.exp(log_spread)
    bulk = -0.5 * ((rates - mean) / sigma) ** 2 - log_sigma - log_ndtr(mean / sigma)
    logs = np.log(np.maximum(rates, 1e-6))
    hot = -0.5 * ((logs - log_hot) / spread) ** 2 - log_spread - logs
    shares = -np.logaddexp(0, logit), -np.logaddexp(0, -logit)
    return float(np.logaddexp(shares[0] + bulk, shares[1] + hot).sum())


def _parameters(solution: Floats, scale: float) -> DarkCounts:
    mean, log_sigma, logit, log_hot, log_spread = np.clip(solution, -_EXPONENT, _EXPONENT)
    variance = np.exp(2 * log_spread)
    middle = float(np.exp(min(log_hot + variance / 2, 2 * _EXPONENT)))
    return DarkCounts(
        bulk_mean_hz_um2=max(float(mean), 0.0) * scale,
        bulk_sigma_hz_um2=float(np.exp(log_sigma)) * scale,
        hot_fraction=float(1 / (1 + np.exp(-logit))),
        hot_mean_hz_um2=middle * scale,
        hot_sigma_hz_um2=middle * float(np.sqrt(np.expm1(min(variance, 2 * _EXPONENT)))) * scale,
    )


def cumulative(dark_counts: DarkCounts, rates: Floats) -> Floats:
    """Return the share of pixels up to each rate per area."""
    mean, sigma = dark_counts.bulk_mean_hz_um2, dark_counts.bulk_sigma_hz_um2
    bulk = np.where(rates >= mean, 1.0, 0.0)
    if sigma > 0:
        bulk = 1 - ndtr((mean - rates) / sigma) / ndtr(mean / sigma)
    hot = np.zeros_like(bulk)
    if dark_counts.hot_fraction > 0:
        variance = np.log1p((dark_counts.hot_sigma_hz_um2 / dark_counts.hot_mean_hz_um2) ** 2)
        logs = np.log(np.maximum(rates, 1e-300) / dark_counts.hot_mean_hz_um2) + variance / 2
        hot = ndtr(logs / np.sqrt(max(variance, 1e-12)))
    share = dark_counts.hot_fraction
    return np.asarray((1 - share) * np.clip(bulk, 0, 1) + share * hot)
