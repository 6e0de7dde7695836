#!/usr/bin/env python3
"""Registration on one thread: this repository against ONNX Runtime, on the same weights, in turns.

    python3 -m venv venv && venv/bin/pip install numpy onnx onnxruntime
    cargo build --release -p host-train
    venv/bin/python tests/compare_onnxruntime.py --weights core/weights/reagent.rgw

Both register clouds of 1024 points in ten steps, the target's embedding included: eleven embeddings and ten
times both heads. ONNX Runtime gets the embedding as 1x1 convolutions over the cloud and the heads as matrix
products on two features; in int8 as static QDQ per channel, unsigned activations by signed weights.

The programs take turns in many short rounds, since other work on a machine comes and goes, and times are
processor times. What is printed is the median over rounds of ONNX Runtime's best time divided by ours in the
same round, and the best time of each in all rounds.

`--avx2` limits both to AVX2: ours by `--isa`, ONNX Runtime, which has no such option, by letting the CPUID
instruction fault and answering it without the newer extensions (Linux, on processors that can; a C compiler).
"""

import argparse
import json
import os
import statistics
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

POINTS, STEPS, PANEL = 1024, 10, 16
EMBED = [(3, 64), (64, 128), (128, 1024)]
HEAD = [(2048, 512), (512, 256), (256, 33)]

# Answers CPUID without AVX-512, AVX-VNNI and AMX in the process that loads it.
MASK = r"""
#define _GNU_SOURCE
#include <signal.h>
#include <sys/syscall.h>
#include <ucontext.h>
#include <unistd.h>
#include <cpuid.h>
#include <asm/prctl.h>

static int faulting(int on) { return syscall(SYS_arch_prctl, ARCH_SET_CPUID, !on); }

static void answer(int signal_, siginfo_t *info, void *context) {
    greg_t *r = ((ucontext_t *)context)->uc_mcontext.gregs;
    const unsigned char *code = (const unsigned char *)r[REG_RIP];
    if (code[0] != 0x0f || code[1] != 0xa2) {
        signal(SIGSEGV, SIG_DFL);
        return;
    }
    unsigned leaf = r[REG_RAX], sub = r[REG_RCX], a, b, c, d;
    faulting(0);
    __cpuid_count(leaf, sub, a, b, c, d);
    faulting(1);
    if (leaf == 7 && sub == 0) {
        b &= ~((1u << 16) | (1u << 17) | (1u << 21) | (0xfu << 26 & ~(1u << 29)) | (3u << 30));
        c &= ~((1u << 1) | (1u << 6) | (1u << 11) | (1u << 12) | (1u << 14));
        d &= ~((1u << 2) | (1u << 3) | (1u << 8) | (1u << 22) | (1u << 23) | (1u << 24) | (1u << 25));
    }
    if (leaf == 7 && sub == 1) {
        a &= ~((1u << 4) | (1u << 5));
        d &= ~((1u << 4) | (1u << 5) | (1u << 10));
    }
    r[REG_RAX] = a, r[REG_RBX] = b, r[REG_RCX] = c, r[REG_RDX] = d;
    r[REG_RIP] += 2;
}

__attribute__((constructor)) static void mask(void) {
    struct sigaction action = {.sa_sigaction = answer, .sa_flags = SA_SIGINFO | SA_NODEFER};
    sigaction(SIGSEGV, &action, 0);
    if (faulting(1) != 0) {
        static const char why[] = "this processor or kernel cannot fault CPUID\n";
        (void)!write(2, why, sizeof why - 1);
        _exit(3);
    }
}
"""


def restart_masked():
    """Starts this script anew under the mask."""
    folder = Path(tempfile.mkdtemp())
    source, library = folder / "mask.c", folder / "mask.so"
    source.write_text(MASK)
    subprocess.run(["cc", "-O1", "-shared", "-fPIC", "-o", library, source], check=True)
    os.environ["LD_PRELOAD"] = str(library)
    os.environ["COMPARE_MASKED"] = "1"
    os.execv(sys.executable, [sys.executable, *sys.argv])


def read_weights(path):
    """Weights [outputs, inputs] and bias of each layer, from a file as core/src/weights.rs describes it."""
    import numpy as np

    data = Path(path).read_bytes()
    magic, version, kind = struct.unpack_from("<4sHH", data)
    if (magic, version, kind) != (b"RGNT", 1, 0):
        sys.exit(f"{path}: not a policy in f32")
    layers = []
    for i in range(9):
        inputs, outputs, weights, bias = struct.unpack_from("<4I", data, 32 + 16 * i)
        panels = -(-outputs // PANEL)
        w = np.frombuffer(data, "<f4", inputs * panels * PANEL, weights)
        w = w.reshape(panels, inputs, PANEL).transpose(0, 2, 1).reshape(-1, inputs)
        layers.append((w[:outputs].copy(), np.frombuffer(data, "<f4", outputs, bias).copy()))
    shapes = [(w.shape[1], w.shape[0]) for w, _ in layers]
    assert shapes == EMBED + HEAD + HEAD, shapes
    return layers


def write_graphs(layers, folder):
    """The embedding and the heads as two graphs."""
    from onnx import TensorProto, helper, numpy_helper, save

    def model(name, nodes, constants, given, results):
        info = lambda pairs: [helper.make_tensor_value_info(n, TensorProto.FLOAT, s) for n, s in pairs]
        tensors = [numpy_helper.from_array(value, key) for key, value in constants.items()]
        graph = helper.make_graph(nodes, name, info(given), info(results), tensors)
        made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)])
        made.ir_version = 9
        save(made, str(folder / f"{name}.onnx"))

    nodes, constants, x = [], {}, "points"
    for i, (w, b) in enumerate(layers[:3]):
        constants |= {f"w{i}": w[:, :, None], f"b{i}": b}
        nodes.append(helper.make_node("Conv", [x, f"w{i}", f"b{i}"], [f"y{i}"], kernel_shape=[1]))
        x = f"y{i}"
        if i < 2:
            nodes.append(helper.make_node("Relu", [x], [f"z{i}"]))
            x = f"z{i}"
    nodes.append(helper.make_node("ReduceMax", [x], ["feature"], axes=[2], keepdims=0))
    model("embedding", nodes, constants, [("points", [1, 3, POINTS])], [("feature", [1, 1024])])

    nodes, constants, results = [], {}, []
    for h, head in enumerate([layers[3:6], layers[6:9]]):
        x = "state"
        for i, (w, b) in enumerate(head):
            key = f"{h}{i}"
            constants |= {f"w{key}": w, f"b{key}": b}
            nodes.append(helper.make_node("Gemm", [x, f"w{key}", f"b{key}"], [f"y{key}"], transB=1))
            x = f"y{key}"
            if i < 2:
                nodes.append(helper.make_node("Relu", [x], [f"z{key}"]))
                x = f"z{key}"
        results.append((x, [1, 33]))
    model("heads", nodes, constants, [("state", [1, 2048])], results)


def quantise(folder, clouds, session):
    """Both graphs in int8, calibrated on what they see."""
    import numpy as np
    from onnxruntime.quantization import CalibrationDataReader, QuantFormat, QuantType, quantize_static

    class Reader(CalibrationDataReader):
        def __init__(self, name, values):
            self.values = iter([{name: value} for value in values])

        def get_next(self):
            return next(self.values, None)

    embed = session(folder / "embedding.onnx")
    features = [embed.run(None, {"points": cloud})[0] for cloud in clouds]
    states = [np.concatenate([a, b], 1) for a, b in zip(features, features[1:] + features[:1])]
    for name, key, values in [("embedding", "points", clouds), ("heads", "state", states)]:
        quantize_static(
            folder / f"{name}.onnx",
            folder / f"{name}-int8.onnx",
            Reader(key, values),
            quant_format=QuantFormat.QDQ,
            per_channel=True,
            activation_type=QuantType.QUInt8,
            weight_type=QuantType.QInt8,
        )


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--weights", default="core/weights/reagent.rgw", help="policy in f32")
    parser.add_argument("--program", default="target/release/host-train", help="our side")
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--count", type=int, default=15, help="registrations of each in a round")
    parser.add_argument("--avx2", action="store_true", help="both without AVX-512, VNNI and AMX")
    parser.add_argument("--json", help="write what was measured")
    options = parser.parse_args()
    if options.avx2 and "COMPARE_MASKED" not in os.environ:
        restart_masked()

    import numpy as np
    import onnxruntime as ort

    def session(path):
        settings = ort.SessionOptions()
        settings.intra_op_num_threads = settings.inter_op_num_threads = 1
        settings.log_severity_level = 3
        return ort.InferenceSession(str(path), settings, providers=["CPUExecutionProvider"])

    folder = Path(tempfile.mkdtemp())
    write_graphs(read_weights(options.weights), folder)
    draw = np.random.default_rng(1)
    clouds = [draw.uniform(-1, 1, (1, 3, POINTS)).astype(np.float32) for _ in range(8)]
    quantise(folder, clouds, session)
    graphs = {
        form: (session(folder / f"embedding{end}.onnx"), session(folder / f"heads{end}.onnx"))
        for form, end in [("f32", ""), ("int8", "-int8")]
    }

    def theirs(form):
        embed, heads = graphs[form]
        feature = lambda cloud: embed.run(None, {"points": cloud})[0]
        times = []
        for i in range(options.count):
            clock = time.process_time()
            target = feature(clouds[i % 8])
            for _ in range(STEPS):
                heads.run(None, {"state": np.concatenate([feature(clouds[(i + 1) % 8]), target], 1)})
            times.append(1e3 * (time.process_time() - clock))
        return min(times)

    # Our program does not need the mask, which ends where a program starts.
    environment = {k: v for k, v in os.environ.items() if k != "LD_PRELOAD"}
    command = [options.program, "bench", "--weights", options.weights, "--points", str(POINTS)]
    command += ["--threads", "1", "--count", str(options.count)]
    command += ["--isa", "avx2+fma"] if options.avx2 else []
    answer = folder / "ours.json"

    def ours():
        subprocess.run([*command, "--json", answer], check=True, stdout=subprocess.DEVNULL, env=environment)
        report = json.loads(answer.read_text())["registration"]
        return report["kernels"], {row["format"]: row["cpu_ms_best"] for row in report["rows"]}

    for form in graphs:
        theirs(form)
    rounds = []
    for _ in range(options.rounds):
        kernels, here = ours()
        there = {form: theirs(form) for form in graphs}
        rounds.append({form: (here[form], there[form]) for form in graphs})
    print(f"ONNX Runtime {ort.__version__}{', AVX2' if options.avx2 else ''}; here {kernels}; one thread")
    summary = {}
    for form in graphs:
        pairs = [r[form] for r in rounds]
        summary[form] = {
            "ratio_median": statistics.median(b / a for a, b in pairs),
            "ours_best_ms": min(a for a, _ in pairs),
            "onnxruntime_best_ms": min(b for _, b in pairs),
        }
        s = summary[form]
        print(
            f"{form:<5} here {s['ours_best_ms']:6.2f} ms, ONNX Runtime {s['onnxruntime_best_ms']:6.2f} ms,"
            f" {s['ratio_median']:.2f} times as fast in the median of {len(pairs)} rounds"
        )
    if options.json:
        Path(options.json).write_text(json.dumps({"kernels": kernels, **summary, "rounds": rounds}, indent=1))


if __name__ == "__main__":
    main()
