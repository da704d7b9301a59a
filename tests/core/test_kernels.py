"""How kernels are lifted, cached and kept out of ``import wavegym``."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import oracles
import pytest

import wavegym
from wavegym.core import kernels
from wavegym.core.errors import InputError
from wavegym.sensors import range_law_snr
from wavegym.trackers import predict, predict_covariance, update_covariance
from wavegym.trackers.kernels import update_covariance as lifted

PACKAGE = Path(wavegym.__file__).parent
RNG = np.random.default_rng(0)
P, H, R = oracles.random_covariance(RNG, 3, (4,)), RNG.standard_normal((2, 3)), oracles.random_covariance(RNG, 2)


def test_leading_axes_broadcast_like_numpys():
    reference = update_covariance(P, H, R)
    assert reference.shape == (4, 3, 3)
    wide = update_covariance(P[:, None], H, np.broadcast_to(R, (1, 5, 2, 2)))
    assert wide.shape == (4, 5, 3, 3)
    assert (wide == reference[:, None]).all()
    assert update_covariance(P[0], H, R).shape == (3, 3)
    assert update_covariance(P[:0], H, R).shape == (0, 3, 3)
    assert np.shape(range_law_snr(25e3)) == ()
    assert (range_law_snr([25e3, 50e3]) == [16.0, 1.0]).all()
    mean, covariance = predict(np.zeros((2, 1, 3)), P, np.eye(3), np.zeros((3, 3)))
    assert mean.shape == (2, 4, 3)
    assert (covariance == P).all()


@pytest.mark.parametrize(
    "shapes",
    [
        ((3, 3), (2, 4), (2, 2)),  # n disagrees
        ((3, 3), (2, 3), (3, 3)),  # m disagrees
        ((3, 2), (2, 3), (2, 2)),  # not square
        ((3,), (2, 3), (2, 2)),  # too few axes
        ((4, 3, 3), (2, 3), (5, 2, 2)),  # leading axes disagree
    ],
)
def test_shapes_that_do_not_fit_are_named(shapes):
    with pytest.raises(
        InputError, match=re.escape(f"update_covariance: argument shapes are {shapes}, expected shapes")
    ):
        lifted(*(np.ones(shape) for shape in shapes))


def test_any_memory_layout_gives_the_same_bits_from_one_compiled_version():
    reference = update_covariance(P, H, R)
    (dispatcher,) = (c.cell_contents for c in lifted.__closure__ if hasattr(c.cell_contents, "signatures"))
    versions = len(dispatcher.signatures)
    frozen = P.copy()
    frozen.flags.writeable = False
    strided = np.zeros((8, 3, 6))
    strided[::2, :, ::2] = P
    for form in (frozen, strided[::2, :, ::2], np.asfortranarray(P), np.swapaxes(P, 1, 2), P.tolist()):
        assert (update_covariance(form, np.asfortranarray(H), R) == reference).all()
    assert (update_covariance(np.broadcast_to(P[0], (4, 3, 3)), H, R) == reference[0]).all()
    whole = np.ones((3, 3), dtype=int) + 10 * np.eye(3, dtype=int)
    assert (update_covariance(whole, H, R) == update_covariance(whole.astype(float), H, R)).all()
    assert len(dispatcher.signatures) == versions
    assert (frozen == P).all()


def test_results_do_not_share_memory_with_the_arguments():
    before = P.copy()
    result = predict_covariance(P, np.eye(3), np.zeros((3, 3)))
    result[...] = 0.0
    assert (before == P).all()


def test_a_constant_argument_compiles_no_version_of_its_own():
    @kernels.kernel
    def entry(x, i):
        return x[i]

    @kernels.kernel
    def ends(x, last):
        return entry(x, 0) + entry(x, 1) + entry(x, last)

    assert ends(np.array([1.0, 2.0, 4.0]), 2) == 7.0
    assert len(entry.signatures) == 1


def test_kernels_live_in_kernel_files():
    """The hashes of cache folders cover these files only."""
    made = re.compile(r"^\s*@(kernel|batched|numba\.|njit|jit|vectorize|guvectorize)|\bnjit\(", re.MULTILINE)
    files = list(PACKAGE.rglob("*.py"))
    elsewhere = [f.name for f in files if not f.name.endswith("kernels.py") and made.search(f.read_text("utf-8"))]
    assert elsewhere == []
    assert sum(bool(made.search(f.read_text("utf-8"))) for f in files) >= 4


def test_a_cache_folder_covers_the_kernel_files_that_a_module_imports():
    """And no others: an edit elsewhere must not compile everything anew."""
    import wavegym.trackers.gaussian_mixture_kernels as mixtures

    found = {str(source.relative_to(PACKAGE)) for source in kernels._sources(mixtures.__name__)}
    assert found >= {
        "core/kernels.py",
        "trackers/gaussian_mixture_kernels.py",
        "trackers/jpda_kernels.py",  # imported by it
        "trackers/association_kernels.py",  # imported by the former
    }
    assert not any(name.startswith("systems/") for name in found)
    assert kernels._sources("wavegym.systems") == frozenset()


@pytest.mark.slow
def test_an_edited_callee_in_another_file_is_noticed(tmp_path):
    """What Numba's own cache would miss: the caller's file stays the same."""
    (tmp_path / "callee_kernels.py").write_text(_CALLEE.format("3.0"))
    (tmp_path / "caller_kernels.py").write_text(_CALLER)
    code = "from pathlib import Path; import wavegym.core.kernels as k\n"
    code += "import caller_kernels; print(caller_kernels.caller(7.0))"
    answers = []
    for factor in ("3.0", "5.0"):
        (tmp_path / "callee_kernels.py").write_text(_CALLEE.format(factor))
        answers.append(float(_python(code, cwd=tmp_path).split()[-1]))
    assert answers == [21.0, 35.0]


@pytest.mark.slow
def test_equal_sources_share_compiled_code_wherever_they_are(tmp_path):
    code = "import callee_kernels as c; print(c.callee(7.0), *c.callee.stats.cache_misses)"
    found = []
    for checkout in ("one", "other"):
        (tmp_path / checkout).mkdir()
        (tmp_path / checkout / "callee_kernels.py").write_text(_CALLEE.format("3.0"))
        found.append(_python(code, cwd=tmp_path / checkout, cache=tmp_path).split())
    assert [len(each) for each in found] == [2, 1]


@pytest.mark.slow
def test_an_edited_constant_is_noticed_in_a_file_of_any_name(tmp_path):
    code = "import my_system; print(my_system.callee(7.0))"
    for factor, answer in (("3.0", "21.0"), ("5.0", "35.0")):
        (tmp_path / "my_system.py").write_text(_CALLEE.format("FACTOR") + f"FACTOR = {factor}")
        assert _python(code, cwd=tmp_path, cache=tmp_path).split() == [answer]


_CALLEE = """
from wavegym.core.kernels import kernel
@kernel
def callee(x):
    return {} * x
"""
_CALLER = """
from wavegym.core.kernels import kernel
from callee_kernels import callee
@kernel
def caller(x):
    return callee(x)
"""


def test_importing_wavegym_stays_light():
    heavy = ("numba", "scipy.stats", "filterpy", "matplotlib", "torch")
    code = f"import sys, wavegym; wavegym.list_envs(); print([m for m in {heavy} if m in sys.modules])"
    assert _python(code).strip() == "[]"


def _python(code, cwd=None, cache=None):
    # No .pyc: Python would take a file of the same size, rewritten within the same second, for the old one.
    path = {"PYTHONPATH": f"{PACKAGE.parent}", "PATH": "", "NUMBA_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"}
    path |= {"XDG_CACHE_HOME": str(cache)} if cache else {}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=cwd, env=path, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
def test_without_a_cache_that_can_be_written_there_is_one_warning_and_kernels_work():
    """A read-only package in a read-only home."""
    code = (
        "import os, pathlib, warnings\n"
        "may = os.access\n"
        "os.access = lambda path, mode: False if mode == os.W_OK else may(path, mode)\n"
        "os.environ['XDG_CACHE_HOME'] = '/nowhere/to/write'\n"
        "with warnings.catch_warnings(record=True) as caught:\n"
        "    warnings.simplefilter('always')\n"
        "    from wavegym.sensors import range_law_snr\n"
        "    import wavegym.core.kernels as k\n"
        "told = [w for w in caught if 'cannot be written' in str(w.message)]\n"
        "assert len(told) == 1, caught\n"
        "@k.kernel\n"
        "def double(x):\n"
        "    return 2.0 * x\n"
        "assert double(3.0) == 6.0\n"
        "assert not pathlib.Path('/nowhere').exists()\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
