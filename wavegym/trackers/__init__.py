"""Trackers: functions that turn a measurement and its covariance into a belief about a target.

>>> import numpy as np
>>> from wavegym.trackers import predict, update
>>> F, Q = np.array([[1.0, 1.0], [0.0, 1.0]]), np.eye(2)
>>> mean, covariance = predict(np.zeros((3, 2)), 100 * np.eye(2), F, Q)  # three tracks in one call
>>> mean, covariance = update(mean, covariance, np.ones((3, 2)), np.eye(2), np.eye(2))
>>> covariance.shape
(3, 2, 2)
"""

from wavegym.sensors.multistatic import multilaterate
from wavegym.trackers.association import Association, LmipdaUpdate, joint_association, lmipda
from wavegym.trackers.gaussian_mixture import GaussianMixture, MixtureUpdate, mixture_update, single_gaussian
from wavegym.trackers.imm import imm_combine, imm_mix, imm_reweigh, imm_ukf_scan, ukf_update, variable_structure
from wavegym.trackers.jpda import fitted_information_reduction, information_reduction, jpda_update
from wavegym.trackers.kalman import (
    check_positive_definite,
    ekf_predict,
    ekf_update,
    nees,
    predict,
    predict_covariance,
    scalar_updates,
    update,
    update_covariance,
)
from wavegym.trackers.rbpf import Particles, RbpfUpdate, rbpf_update, systematic_resample
from wavegym.trackers.track_metrics import Gospa, Siap, gospa, ospa, siap

__all__ = [
    "Association",
    "GaussianMixture",
    "Gospa",
    "LmipdaUpdate",
    "MixtureUpdate",
    "Particles",
    "RbpfUpdate",
    "Siap",
    "check_positive_definite",
    "ekf_predict",
    "ekf_update",
    "fitted_information_reduction",
    "gospa",
    "imm_combine",
    "imm_mix",
    "imm_reweigh",
    "imm_ukf_scan",
    "information_reduction",
    "joint_association",
    "jpda_update",
    "lmipda",
    "mixture_update",
    "multilaterate",
    "nees",
    "ospa",
    "predict",
    "predict_covariance",
    "rbpf_update",
    "scalar_updates",
    "siap",
    "single_gaussian",
    "systematic_resample",
    "ukf_update",
    "update",
    "update_covariance",
    "variable_structure",
]
