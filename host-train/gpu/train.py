"""Imitation learning of a policy for views on a GPU.

The method is that of `host-train train --stage il --follow mean`: the policy acts from its own mean, the steady expert
labels every state that it visits (equation 10 of the paper), and the cross-entropy to these labels is minimised. What is
looked at of both clouds is chosen as core/src/cut.rs and core/src/focus.rs choose it. Views come from `host-train views`,
which writes one file after the other into a folder; the network goes back through `host-train import`.

    python3 train.py --views FOLDER --minutes 20 --out FILE.pt [--init FILE.pt] [--compact]
"""

import argparse
import math
import pathlib
import random
import threading
import time

import numpy as np
import torch
from torch import nn
from torch.nn import functional as F

SIZES = [-0.27, -0.09, -0.03, -0.01, -0.0033, 0.0, 0.0033, 0.01, 0.03, 0.09, 0.27]
STEPS = 10  # of a registration
CUT = 1.25  # radii within which the source is looked at
FOCUS = 3  # steps from one choice of the target's points to the next
SIDE, HALF, FEWEST = 16, 1.28, 32  # of core/src/focus.rs
FULL = ([64, 128, 1024], [512, 256])
COMPACT = ([64, 64, 384], [128, 64])


class Network(nn.Module):
    """The authors' network, by their names."""

    def __init__(self, shape):
        super().__init__()
        (w1, w2, w3), (h1, h2) = shape
        self.state_emb = nn.ModuleDict(
            {"conv1": nn.Linear(3, w1), "conv2": nn.Linear(w1, w2), "conv3": nn.Linear(w2, w3)}
        )
        head = lambda: nn.Sequential(nn.Linear(2 * w3, h1), nn.ReLU(), nn.Linear(h1, h2), nn.ReLU())
        self.actor_critic = nn.ModuleDict(
            {
                "emb_t": head(),
                "action_t": nn.Linear(h2, 33),
                "emb_r": head(),
                "action_r": nn.Linear(h2, 33),
                "emb_v": nn.Sequential(nn.Linear(2 * h2, h2), nn.ReLU()),
                "value": nn.Linear(h2, 1),
            }
        )

    def embed(self, points):
        """Features [B, F] of clouds [B, N, 3]: which point reaches a maximum is found in bfloat16, its value in f32."""
        e = self.state_emb
        hidden = F.relu(e["conv2"](F.relu(e["conv1"](points))))
        with torch.no_grad():
            weight = e["conv3"].weight.bfloat16().t()
            best = torch.cat([(part.bfloat16() @ weight).argmax(1) for part in hidden.split(1024)])
        picked = hidden.gather(1, best.unsqueeze(2).expand(-1, -1, hidden.shape[2]))
        return (picked * e["conv3"].weight).sum(2) + e["conv3"].bias

    def logits(self, source, target):
        """Logits [B, 6, 11], translation first."""
        state = torch.cat([source, target], 1)
        a = self.actor_critic
        t, r = a["action_t"](a["emb_t"](state)), a["action_r"](a["emb_r"](state))
        return torch.cat([t.view(-1, 3, 11), r.view(-1, 3, 11)], 1)


def seen(source, centroid, rotation, translation):
    return (source - centroid[:, None]) @ rotation.transpose(1, 2) + (centroid + translation)[:, None]


def kept_only(points, kept):
    """Points that are left out give way to the first that is kept: a maximum does not see the difference."""
    first = kept.float().argmax(1)
    return torch.where(kept[:, :, None], points, points.gather(1, first[:, None, None].expand(-1, 1, 3)))


def reached(points):
    kept = points.square().sum(2) <= CUT * CUT
    return kept | (kept.sum(1) < 3)[:, None]


def cells(points):
    place = torch.floor((points + HALF) * (SIDE / (2 * HALF)))
    inside = ((place >= 0) & (place < SIDE)).all(2)
    x, y, z = place.clamp(0, SIDE - 1).long().unbind(2)
    return (z * SIDE + y) * SIDE + x, inside


def focused(points, kept, target):
    """Points of the target near the source, as it is seen."""
    place, inside = cells(points)
    filled = torch.zeros(len(points), SIDE**3, device=points.device)
    filled.scatter_reduce_(1, place, (kept & inside).float(), "amax")
    grown = F.max_pool3d(filled.view(-1, 1, SIDE, SIDE, SIDE), 3, 1, 1).view(len(points), -1)
    place, inside = cells(target)
    near = (grown.gather(1, place) > 0) & inside
    near = near | (near.sum(1) < FEWEST)[:, None]
    return kept_only(target, near)


def steady(delta, sizes):
    """The largest step below the error."""
    index = (delta.abs()[..., None] > sizes[6:]).sum(-1)
    return torch.where(delta < 0, 5 - index, 5 + index)


def expert(rotation, translation, sizes):
    x, y, z = rotation.unbind(2)
    euler = torch.stack(
        [torch.atan2(-z[:, 1], z[:, 2]), torch.asin(z[:, 0].clamp(-1, 1)), torch.atan2(-y[:, 0], x[:, 0])], 1
    )
    return steady(torch.cat([translation, euler], 1), sizes)


def turned(angles):
    (a, b, c) = angles.unbind(1)
    sa, ca, sb, cb, sc, cc = a.sin(), a.cos(), b.sin(), b.cos(), c.sin(), c.cos()
    columns = [
        [cb * cc, ca * sc + sa * sb * cc, sa * sc - ca * sb * cc],
        [-cb * sc, ca * cc - sa * sb * sc, sa * cc + ca * sb * sc],
        [sb, -sa * cb, ca * cb],
    ]
    return torch.stack([torch.stack(column, 1) for column in columns], 2)


class Problems:
    """Views on the device, and what registers them."""

    def __init__(self, views, points):
        source, target, pose = views[:, :points], views[:, points : 2 * points], views[:, 2 * points :]
        self.source, self.target = source.contiguous(), target.contiguous()
        rotation, translation = pose[:, :3].transpose(1, 2), pose[:, 3]
        kept = reached(source)
        self.centroid = (source * kept[:, :, None]).sum(1) / kept.sum(1, keepdim=True)
        self.rotation = rotation.contiguous()
        moved = (rotation @ self.centroid[:, :, None]).squeeze(2) + translation
        self.translation = moved - self.centroid

    def __len__(self):
        return len(self.source)


@torch.no_grad()
def roll_out(network, problems, sizes):
    """States [B * STEPS], with the expert's labels."""
    count = len(problems)
    rotation = torch.eye(3, device=sizes.device).repeat(count, 1, 1)
    translation = torch.zeros(count, 3, device=sizes.device)
    rotations, translations, labels, chosen = [], [], [], []
    for step in range(STEPS):
        points = seen(problems.source, problems.centroid, rotation, translation)
        kept = reached(points)
        if step % FOCUS == 0:
            chosen.append(focused(points, kept, problems.target))
            target = network.embed(chosen[-1])
        logits = network.logits(network.embed(kept_only(points, kept)), target)
        mean = (logits.softmax(2) * sizes).sum(2)
        action = (sizes - mean[..., None]).abs().argmin(2)
        labels.append(
            expert(problems.rotation @ rotation.transpose(1, 2), problems.translation - translation, sizes)
        )
        rotations.append(rotation)
        translations.append(translation)
        moves = sizes[action]
        rotation = turned(moves[:, 3:]) @ rotation
        translation = translation + moves[:, :3]
    left = problems.rotation @ rotation.transpose(1, 2)
    angle = torch.rad2deg(torch.acos(((left.diagonal(dim1=1, dim2=2).sum(1) - 1) / 2).clamp(-1, 1)))
    errors = (angle.median().item(), (problems.translation - translation).norm(dim=1).median().item())
    return torch.cat(rotations), torch.cat(translations), torch.cat(labels), chosen, errors


def learn(network, optimiser, averaged, decay, problems, states, batch, sizes):
    rotations, translations, labels, chosen, errors = states
    count = len(problems)
    order = torch.randperm(len(labels), device=sizes.device)
    total, agreed, batches = 0.0, 0.0, 0
    targets = torch.stack(chosen)
    for rows in order.split(batch):
        problem, phase = rows % count, (rows // count) // FOCUS
        points = seen(problems.source[problem], problems.centroid[problem], rotations[rows], translations[rows])
        source = kept_only(points, reached(points))
        features = network.embed(torch.cat([source, targets[phase, problem]]))
        logits = network.logits(*features.chunk(2))
        loss = F.cross_entropy(logits.flatten(0, 1), labels[rows].flatten())
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimiser.step()
        with torch.no_grad():
            torch._foreach_lerp_(averaged, list(network.parameters()), 1 - decay)
            total = total + loss.detach()
            agreed = agreed + (logits.argmax(2) == labels[rows]).float().mean()
        batches += 1
    return float(total) / batches, float(agreed) / batches, batches, errors


class Stream(threading.Thread):
    """Files of views as they come, each deleted when it was read; the last ones again where none is new."""

    def __init__(self, folder, keep=24):
        super().__init__(daemon=True)
        self.folder, self.keep, self.files, self.fresh = pathlib.Path(folder), keep, [], 0
        self.start()

    def run(self):
        while True:
            found = sorted(self.folder.glob("*.npy"))
            for path in found:
                self.files.append(torch.from_numpy(np.load(path)))
                del self.files[: -self.keep]
                self.fresh += 1
                path.unlink()
            if not found:
                time.sleep(0.05)

    def next(self, taken):
        """A file that was not taken yet, else one of the last."""
        while not self.files:
            time.sleep(0.1)
        files, fresh = list(self.files), self.fresh
        if fresh > taken:
            return files[-min(len(files), fresh - taken)], max(taken + 1, fresh - len(files) + 1)
        return random.choice(files), taken


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--views", required=True)
    parser.add_argument("--minutes", type=float, required=True)
    parser.add_argument("--out", required=True)
    parser.add_argument("--init")
    parser.add_argument("--compact", action="store_true")
    parser.add_argument("--points", type=int, default=512)
    parser.add_argument("--all-points-from", type=float, default=0.75, help="share of the time after which all points are used")
    parser.add_argument("--problems", type=int, default=4096)
    parser.add_argument("--batch", type=int, default=2048)
    parser.add_argument("--rate", type=float, default=1e-3)
    parser.add_argument("--average", type=float, default=0.9995)
    parser.add_argument("--save-minutes", type=float, default=2.0)
    args = parser.parse_args()
    torch.manual_seed(42)
    torch.backends.cuda.matmul.allow_tf32 = True
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    sizes = torch.tensor(SIZES, device=device)
    network = Network(COMPACT if args.compact else FULL).to(device)
    if args.init:
        network.load_state_dict(torch.load(args.init, map_location=device))
    averaged = [p.detach().clone() for p in network.parameters()]
    optimiser = torch.optim.Adam(network.parameters(), lr=args.rate, fused=device.type == "cuda")

    def save(path):
        names = [name for name, _ in network.named_parameters()]
        state = {name: value.cpu().contiguous() for name, value in zip(names, averaged)}
        torch.save(state, str(path) + ".part")
        pathlib.Path(str(path) + ".part").rename(path)

    stream, taken, begun = Stream(args.views), 0, None
    observations, updates, steps, saved, said = 0, 0, 0, 0.0, 0.0
    while True:
        views, taken = stream.next(taken)
        begun = begun or time.time()
        every = (views.shape[1] - 4) // 2
        mixed = torch.randperm(len(views))
        for rows in mixed.split(args.problems):
            share = (time.time() - begun) / (60 * args.minutes)
            if share >= 1:
                save(args.out)
                print(f"{observations} observations in {args.minutes} minutes, {taken} files", flush=True)
                return
            points = every if share >= args.all_points_from else min(args.points, every)
            which = torch.randperm(every)[:points]
            index = torch.cat([which, every + which, 2 * every + torch.arange(4)])
            problems = Problems(views[rows].to(device, non_blocking=True)[:, index.to(device)], points)
            rate = args.rate * min(1.0, (steps + 1) / 300) * 0.5 * (1 + math.cos(math.pi * share))
            for group in optimiser.param_groups:
                group["lr"] = rate
            decay = min(args.average, (1 + steps) / (10 + steps))
            batch = args.batch * min(args.points, every) // points
            states = roll_out(network, problems, sizes)
            loss, agreed, batches, (angle, shift) = learn(
                network, optimiser, averaged, decay, problems, states, batch, sizes
            )
            observations += len(problems) * STEPS
            updates, steps = updates + 1, steps + batches
            minutes = (time.time() - begun) / 60
            if minutes >= said:
                said = minutes + 0.25
                print(
                    f"{minutes:5.2f} min, {observations / 1e6:6.2f} M, {observations / max(minutes, 1e-9) / 60:8.0f}/s, file {taken}, "
                    f"loss {loss:.4f}, agreement {agreed:.3f}, median {angle:.2f} deg {shift:.4f}, rate {rate:.1e}",
                    flush=True,
                )
            if minutes >= saved + args.save_minutes:
                saved = minutes
                save(args.out)


if __name__ == "__main__":
    main()
