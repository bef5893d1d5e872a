"""Parsed C++ headers: one is made for all compiler flags, whichever threads compile."""

import json
import os
import subprocess
import sys
import threading

import pytest

from lissajous_env.device import headers
from lissajous_env.device.compilation import CONTRACTED, MOTION, OPTIONS

FLAGS = [each["cpu_compiler_flags"] for each in (OPTIONS, MOTION, CONTRACTED)]


@pytest.fixture
def none_made(monkeypatch):
    """Make it so that there is no header yet."""
    monkeypatch.setattr(headers, "_made", [])
    monkeypatch.setattr(headers, "_making", threading.Lock())


@pytest.mark.usefixtures("none_made")
def test_threads_share_the_folder_of_the_first_for_modules_of_this_project():
    # Oracle: a folder for each thread is what Warp has by itself, and what modules of others keep.
    folder = headers.share_headers(lambda: str(threading.get_ident()))
    found = {}

    def look(name):
        found[name, "foreign"] = folder() == str(threading.get_ident())
        for flags in FLAGS:
            with headers.sharing_header(flags):
                found[name, flags] = folder()

    for name in ("first", "second"):
        thread = threading.Thread(target=look, args=(name,))
        thread.start()
        thread.join()
    assert found["first", "foreign"]
    assert found["second", "foreign"]
    assert None not in found.values()
    assert len({found[name, flags] for name in ("first", "second") for flags in FLAGS}) == 1


@pytest.mark.usefixtures("none_made")
def test_a_thread_waits_for_the_header_that_another_makes():
    order, made, begins = [], threading.Event(), threading.Event()

    def compile_first():
        with headers.sharing_header(FLAGS[0]):
            begins.set()
            made.wait(10)
            order.append("first")

    def compile_second():
        begins.wait(10)
        with headers.sharing_header(FLAGS[1]):
            order.append("second")

    threads = [threading.Thread(target=each) for each in (compile_first, compile_second)]
    for thread in threads:
        thread.start()
    begins.wait(10)
    threads[1].join(0.1)
    waited = threads[1].is_alive() and not order
    made.set()
    for thread in threads:
        thread.join(10)
    assert waited
    assert order == ["first", "second"]


@pytest.mark.usefixtures("none_made")
def test_a_failed_compilation_makes_no_header():
    with pytest.raises(ValueError, match="it"), headers.sharing_header(FLAGS[0]):
        raise ValueError("it")
    assert headers._made == []
    with headers.sharing_header(FLAGS[1]):
        pass
    assert headers._made == [FLAGS[1]]


_SCRIPT = """
import hashlib
import json
import threading
from pathlib import Path
import warp as wp
import warp._src.build as build
from lissajous_env.device import kernel_cache
from lissajous_env.device.compilation import CONTRACTED, module_apart
from lissajous_env.device.devices import as_device, compile_quietly
from lissajous_env.world import clock, reward
from lissajous_env.world.robots import point

as_device("cpu")
built, before = [], build.build_cpu

def build_cpu(*args, pch_dir=None, **kwargs):
    before(*args, pch_dir=pch_dir, **kwargs)
    built.append({path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in Path(pch_dir).iterdir()})

build.build_cpu = build_cpu
kernels = [next(each for each in vars(module).values() if isinstance(each, wp.Kernel))
           for module in (clock, reward, point)]

@wp.kernel(module=module_apart("lissajous_env.contracted", CONTRACTED))
def nothing():
    pass

with compile_quietly():
    kernel_cache.load_together([*kernels[1:], nothing], "cpu", lambda: 2)
    twice = [threading.Thread(target=lambda: kernel_cache.load_together(kernels[:1], "cpu", lambda: 1)) for _ in "ab"]
    for thread in twice:
        thread.start()
    for thread in twice:
        thread.join()
print(json.dumps(built))
"""


def test_modules_that_two_threads_compile_have_one_header(tmp_path):
    # Story: a first run, with an empty cache, of modules with three sets of flags. Oracle: the files in the folder that
    # the compiler was given, which would make its own for a set of flags if it did not recognize the copy.
    environment = os.environ | {"WARP_CACHE_PATH": str(tmp_path / "cache")}
    (tmp_path / "script.py").write_text(_SCRIPT)
    done = subprocess.run(
        [sys.executable, tmp_path / "script.py"],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
        timeout=300,
    )
    built = json.loads(done.stdout.splitlines()[-1])
    assert len(built) == 4, "a module that two threads need is compiled by one of them"
    sums = {name: of for paths in built for name, of in paths.items()}
    assert len(sums) == len(FLAGS)
    assert len(set(sums.values())) == 1
