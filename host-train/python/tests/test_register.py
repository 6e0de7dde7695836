"""What a registration gives."""

import copy
import pickle

import numpy
import pytest
from conftest import ROOT, apart, bracket, moved, pose

import reagent


def test_a_pose_is_found_with_a_probability(pair):
    source, target, truth = pair
    found = reagent.register(source, target)
    angle, distance = apart(found.target_from_source, truth)
    assert angle < 0.5 and distance < 0.02
    assert found.target_from_source.shape == (4, 4) and found.target_from_source.dtype == numpy.float64
    assert found.converged and found.verdict == "converged" and 0.9 < found.probability <= 1
    assert 0.5 < found.overlap <= 1 and 0 < found.rmse < 0.1 and found.ms > 0
    assert found.covariance.shape == (6, 6) and found.covariance_about.shape == (3,)
    assert not found.undetermined and found.undetermined.poses.shape == (0, 4, 4)
    assert found.notes == [] and repr(found).startswith("Registration(verdict='converged'")


def test_steps_say_what_the_policy_thought(pair):
    source, target, _ = pair
    steps = reagent.register(source, target, steps=4).steps
    assert [step.number for step in steps] == list(range(1, len(steps) + 1)) and 1 <= len(steps) <= 4
    for step in steps:
        for taken, probability in [
            (step.translation_id, step.translation_probability),
            (step.rotation_id, step.rotation_probability),
        ]:
            assert probability.shape == (3, 11)
            numpy.testing.assert_allclose(probability.sum(axis=1), 1, rtol=1e-5)
            assert all(0 <= i < 11 for i in taken)
        assert step.translation.shape == step.rotation_rad.shape == (3,)
        assert step.target_from_source.shape == (4, 4)


def test_modes_say_what_they_can(pair):
    source, target, truth = pair
    fast = reagent.register(source, target, mode="fast")
    assert fast.probability is fast.overlap is fast.rmse is fast.covariance is fast.undetermined is None
    # What nobody looked for is neither open nor closed.
    polished = reagent.register(source, target, mode="polish")
    refined = reagent.refine(source, target, truth)
    for found in [polished, refined]:
        assert found.undetermined is None and "undetermined" not in found.to_dict()
    assert refined.steps == [] and refined.converged
    verified = reagent.verify(source, target, truth)
    assert verified.steps == [] and verified.converged and "verify" in verified.to_dict()
    assert not reagent.refine(source, target, pose(-1, 0)).converged


def test_a_start_may_be_anywhere(pair):
    source, target, truth = pair
    away = pose(-0.6, 0.8, (0, 0, 0))
    far = moved(away, source)
    found = reagent.register(far, target, "anywhere")
    assert apart(found.target_from_source @ away, truth)[0] < 1
    found = reagent.register(far, target, numpy.linalg.inv(away))
    assert apart(found.target_from_source @ away, truth)[0] < 1


def test_what_the_shape_leaves_open_is_named():
    rng = numpy.random.default_rng(3)
    angle, height = 2 * numpy.pi * rng.random(1000), 3 * rng.random(1000)
    rod = numpy.stack([numpy.cos(angle), numpy.sin(angle), height], axis=1)
    found = reagent.register(rod[:500], rod[500:])
    assert found.undetermined
    axis = found.undetermined.axis
    assert abs(axis.direction[2]) > 0.99 and axis.range_deg[1] - axis.range_deg[0] > 60 and axis.point.shape == (3,)
    assert found.undetermined.poses.shape[1:] == (4, 4)


def test_a_rotational_symmetry_is_named_with_all_its_poses():
    rng = numpy.random.default_rng(8)

    def wheel(n):
        x, y, z, spoke = rng.random(n), rng.random(n) - 0.5, rng.random(n) - 0.5, rng.integers(7, size=n)
        side = rng.integers(3, size=n)
        y[side == 0], z[side == 1], x[side == 2] = 0.5 * numpy.sign(y[side == 0]), 0.5 * numpy.sign(z[side == 1]), 1
        # Narrower above, so that it cannot be turned over.
        x, y, z = 0.3 + x, 0.3 * y * (1.3 - z), 0.3 * z
        turn = 2 * numpy.pi * spoke / 7
        return numpy.stack([x * numpy.cos(turn) - y * numpy.sin(turn), x * numpy.sin(turn) + y * numpy.cos(turn), z], axis=1)

    truth = pose()
    found = reagent.register(wheel(2000), moved(truth, wheel(2000)), "anywhere")
    fold = found.undetermined.fold
    assert found.converged and fold.order == 7 and "order=7" in repr(fold)
    axis = truth[:3, 2]
    assert abs(fold.direction @ axis) > 0.999
    assert numpy.linalg.norm(numpy.cross(fold.point - truth[:3, 3], axis)) < 0.02
    assert found.undetermined.poses.shape == (6, 4, 4)
    poses = [found.target_from_source, *found.undetermined.poses]
    assert sum(apart(each, truth)[0] < 1 for each in poses) == 1


def test_coordinates_far_from_the_origin_keep_their_digits(pair):
    source, target, truth = pair
    shift = numpy.array([483221.0, 5456871.0, 310.0])
    near = reagent.register(source, target).target_from_source
    found = reagent.register(source + shift, target + shift)
    back = found.target_from_source.copy()
    back[:3, 3] += back[:3, :3] @ shift - shift
    assert apart(back, near)[1] < 1e-2
    assert len(found.notes) == 2 and "relative to" in found.notes[0]


def test_large_clouds_are_thinned_and_refined_on_all_points():
    truth = pose()
    source, target = bracket(4, 9000), moved(truth, bracket(5, 8000))
    found = reagent.register(source, target)
    assert found.to_dict()["dense"]["points"] == [9000, 8000]
    assert "source: 9000 points are thinned to 2048 for the policy" in found.notes
    angle, distance = apart(found.target_from_source, truth)
    assert angle < 0.1 and distance < 0.01
    assert "dense" not in reagent.register(source, target, dense="never").to_dict()
    assert reagent.register(source, target, points=500).to_dict()["source_points"] == 500


def test_a_registration_can_be_copied_and_its_dict_be_kept(pair):
    source, target, _ = pair
    found = reagent.refine(source, target)
    assert copy.copy(found) is copy.deepcopy(found) is found
    assert pickle.loads(pickle.dumps(found.to_dict())) == found.to_dict()


def test_policies_are_loaded_and_named(tmp_path):
    names = ["reagent", "int8", "compact", "views", "views-compact"]
    assert len({reagent.Policy.pretrained(name).sha256 for name in names}) == 5
    assert reagent.Policy.pretrained().format == "f32"
    file = ROOT / "core/weights/reagent-int8.rgw"
    assert reagent.Policy.load(file).sha256 == reagent.Policy.pretrained("int8").sha256
    with pytest.raises(FileNotFoundError):
        reagent.Policy.load("views")
    path = tmp_path / "none.rgw"
    with pytest.raises(FileNotFoundError, match="cannot read .*none.rgw"):
        reagent.Policy.load(path)
    path.write_bytes(b"nothing")
    with pytest.raises(reagent.PolicyError, match="none.rgw is no usable policy: "):
        reagent.Policy.load(str(path))
    for name in ["other", "", 3, None]:
        with pytest.raises(reagent.Error, match="name: expected int8, reagent, reagent-int8, compact, views, views-compact"):
            reagent.Policy.pretrained(name)


def test_several_starts_and_the_next_best_poses(pair):
    source, target, truth = pair
    flipped = numpy.diag([1.0, -1.0, -1.0, 1.0])
    found = reagent.register(source, target, [flipped, truth], "refine", best=2)
    assert found.start == 1
    angle, distance = apart(found.target_from_source, truth)
    assert angle < 1 and distance < 0.02
    (other,) = found.others
    assert apart(other.target_from_source, truth)[0] > 90
    assert other.probability < found.probability and other.rmse > 0 and 0 <= other.overlap <= 1
    stacked = reagent.register(source, target, numpy.stack([flipped, truth]), "refine", best=2)
    assert (stacked.target_from_source == found.target_from_source).all()
    alone = reagent.register(source, target, truth)
    assert alone.start is None and alone.others == []


def test_what_is_to_be_looked_at_is_noted(pair):
    source, target, _ = pair
    found = reagent.register(1000 * source, target)
    assert found.verdict == "sizes differ" and "about 1" in found.notes[-1] and "mm" in found.notes[-1], found.notes
    assert found.rmse is None and "rmse" not in repr(found)
    marked = numpy.vstack([source, numpy.full((len(source) // 10, 3), -9999.0)])
    assert any("left out" in note for note in reagent.register(marked, target).notes)
    assert "probability=1" not in repr(reagent.register(source, target))
