"""The scene of several targets and sensors: its panels, for every form of action and both trackers."""

import numpy as np
import pytest
from matplotlib.figure import Figure
from scene_plays import drawn, moment_of, of, played

from wavegym.envs.film import make_scene
from wavegym.rendering.maps import colour, ellipse
from wavegym.sensors import inside_gate, mean_inverse_detected_snr, range_and_rate
from wavegym.systems.agile_clutter.scene import draw_map, known_targets, scan_caption, transmitted
from wavegym.systems.agile_clutter.system import AgileClutter
from wavegym.waveforms import TrapezoidChirp

FORMS = ("library", "joint", "box")
BIRTHS, LIFETIME = (0, 3), 5
SYSTEM = AgileClutter(births=BIRTHS, lifetime=LIFETIME, horizon=8)
PARTICLES = AgileClutter(births=BIRTHS, lifetime=LIFETIME, horizon=8, tracker="particle", particles=30)


@pytest.mark.parametrize("step", range(9))
def test_the_map_shows_the_targets_that_the_tracker_knows(step):
    axes = Figure().subplots()
    draw_map(axes, SYSTEM, moment_of(played(SYSTEM, step)))
    present = {t for t in (0, 1) if BIRTHS[t] <= step <= BIRTHS[t] + LIFETIME}
    assert set(known_targets(SYSTEM, step)) == present
    names = {text.get_text() for text in axes.texts}
    for t in (0, 1):
        assert (str(t + 1) in names) == bool(of(colour(t), axes.lines)) == (t in present)


def test_the_map_is_to_scale_and_holds_truth_ellipse_and_directions_to_the_sensors():
    scene, moment = drawn(SYSTEM, 5)
    axes, now = scene._map, moment.states[-1]
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    assert axes.bbox.width / (right - left) == pytest.approx(axes.bbox.height / (top - bottom))
    for t in (0, 1):
        _, trail, means, outline, cross = of(colour(t), axes.lines)
        np.testing.assert_allclose(np.array(cross.get_data())[:, 0], now.truth.targets[0, t, :2] / 1e3)
        points = 1e3 * np.array(outline.get_data()) - now.belief.mean[0, t, :2, None]
        P = now.belief.covariance[0, t, :2, :2]
        np.testing.assert_allclose(np.einsum("ip,ij,jp->p", points, np.linalg.inv(P), points), 4.0, rtol=1e-6)
        assert len(trail.get_xdata()) == len(means.get_xdata()) == 6 - BIRTHS[t]
        for line in (trail, outline):
            x, y = line.get_data()
            assert ((left < x) & (x < right) & (bottom < y) & (y < top)).all()
    centre = now.belief.mean[0, :, :2].mean(axis=0)
    written = [text for text in axes.texts if "sensor" in text.get_text()]
    for i, text in enumerate(written):
        assert text.get_text() == f"to sensor {i + 1}: {np.linalg.norm(SYSTEM.sensors[i] - centre) / 1e3:.1f} km"
    south, north = (text.get_position()[1] for text in written)
    assert south < 0.1
    assert north > 0.9


def test_a_sensor_on_the_map_is_marked():
    system = AgileClutter(births=BIRTHS, lifetime=LIFETIME, horizon=8, sensors=((1.2e3, -400.0),))
    scene, _ = drawn(system, 2)
    markers = [line.get_xydata().tolist() for line in scene._map.lines if line.get_marker() == "^"]
    assert markers == [[[1.2, -0.4]]]


@pytest.mark.slow
def test_a_gate_holds_its_targets_true_measurement_and_the_pulses_own_ellipse():
    held = []
    for seed in range(6):
        scene, moment = drawn(SYSTEM, 1, seed)
        targets, truth = SYSTEM.predicted_targets(moment.states[0].belief), moment.states[-1].truth.targets[0, 0]
        for axes, sensor in zip(scene._gates, SYSTEM.sensors, strict=True):
            gate, pulse, cross = axes.lines
            expected = range_and_rate(truth, sensor) - range_and_rate(targets.mean[0, 0], sensor)
            np.testing.assert_allclose(np.array(cross.get_data())[:, 0], expected)
            points = np.array(gate.get_data())[:, :-1]
            S = 2.0 * (points @ points.T) / points.shape[1]  # of points evenly around an ellipse: its shape matrix
            held.append(inside_gate(expected, S, 1.0))
            assert inside_gate(np.array(pulse.get_data()).T, S, 1.0).all()
            assert len(axes.patches) == 1
    assert np.mean(held) == 1.0


def test_gates_have_the_moments_of_the_true_measurement_function():
    """Sampled through the function that the drawing linearises."""
    scene, moment = drawn(SYSTEM, 1)
    targets, rng = SYSTEM.predicted_targets(moment.states[0].belief), np.random.default_rng(0)
    states = rng.multivariate_normal(targets.mean[0, 0], targets.covariance[0, 0], size=200_000)
    C = SYSTEM.action_set.unit_covariance(moment.actions[-1])[0]
    for i, axes in enumerate(scene._gates):
        z = range_and_rate(states, SYSTEM.sensors[i])
        eta = (SYSTEM.reference_range / z[:, 0].mean()) ** 4
        N = C[i] * mean_inverse_detected_snr(eta, SYSTEM.false_alarm, searched=2, least=1)
        expected = ellipse(np.cov(z.T) + N, SYSTEM.gate)
        reach = np.abs(expected).max(axis=1)
        shown = np.abs(np.array(axes.lines[0].get_data())).max(axis=1)
        np.testing.assert_allclose(shown, reach, rtol=0.01)  # six standard errors of a sampled standard deviation


@pytest.mark.parametrize("form", FORMS)
def test_the_pulses_drawn_are_the_pulses_transmitted(form):
    system = AgileClutter(action=form)
    env = played(system, 0)
    for _ in range(20):
        action = env.action_space.sample()
        pulses = transmitted(system, action)
        C = [pulse.measurement_covariance(system.carrier_hz, 1.0) for pulse in pulses]
        np.testing.assert_allclose(C, system.action_set.unit_covariance(action)[0], rtol=1e-9)


def test_one_law_in_a_box_needs_no_parameter():
    system = AgileClutter(action="box", laws=("pfm:2.5",), sensors=((0.0, -9e3),))
    (pulse,) = transmitted(
        system, system.action_set.encode_chirps(np.array([[0]]), np.array([[2e-5]]), np.array([[-3e6]]))
    )
    assert isinstance(pulse, TrapezoidChirp)
    assert (pulse.kind, pulse.shape, pulse.direction) == ("pfm", 2.5, "down")
    np.testing.assert_allclose([pulse.duration, pulse.sweep], [2e-5, 3e6], rtol=1e-12)


def test_the_caption_counts_what_was_received():
    moment = moment_of(played(SYSTEM, 4))
    detections, clutter = moment.states[-1].truth.scan[0, :2]
    one, two = SYSTEM.state_info(moment.states[-1])["components"][0]
    received = f"2 sensors: {detections:.0f} of 4 returns detected, {clutter:.0f} clutter points in first gates"
    expected = f"{received}  ·  components: {one}, {two}"
    assert scan_caption(SYSTEM, moment) == expected
    assert "of 2 returns" in scan_caption(SYSTEM, moment_of(played(SYSTEM, 1)))
    assert scan_caption(SYSTEM, moment_of(played(SYSTEM, 0))) == ""
    assert "  ·  30 particles: " in scan_caption(PARTICLES, moment_of(played(PARTICLES, 1)))


def test_particles_are_points_of_the_map_and_of_the_errors():
    scene, moment = drawn(PARTICLES, 4)
    now = moment.states[-1]
    for t in (0, 1):
        expected = now.belief.hypotheses.mean[0, :, t, :2]
        cloud = next(line for line in of(colour(t), scene._map.lines) if len(line.get_xdata()) == 30)
        np.testing.assert_allclose(1e3 * cloud.get_xydata(), expected)
        cloud = next(line for line in of(colour(t), scene._errors.lines) if len(line.get_xdata()) == 30)
        np.testing.assert_allclose(cloud.get_xydata(), expected - now.truth.targets[0, t, :2])


def test_a_pulse_sent_again_after_another_is_drawn_again():
    figure = Figure(figsize=(5.76, 6.4))
    scene = make_scene(SYSTEM, figure.subfigures(1, 1))
    env, shown = played(SYSTEM, 0), []
    for action in ([0, 1], [0, 40], [3, 40], [0, 1]):
        env.step(np.array([action]))
        scene.draw(moment_of(env))
        shown.append([np.array(axes.images[0].get_array()) for axes in scene._pulses])
    for sensor in (0, 1):
        assert (shown[0][sensor] == shown[3][sensor]).all()
    assert (shown[0][0] == shown[1][0]).all()
    assert (shown[0][1] != shown[1][1]).any()
    assert (shown[1][0] != shown[2][0]).any()


@pytest.mark.parametrize("count", [1, 3])
def test_other_numbers_of_sensors_are_drawn_too(count):
    sites = ((3e3, -16e3), (3e3, 20.4e3), (-9e3, 500.0))[:count]
    env = played(AgileClutter(sensors=sites, action="box", laws=("lfm",)), 2)
    assert env.render()[0].std() > 10
    assert len(env._film._canvas._parts[0]._gates) == min(count, 2)
