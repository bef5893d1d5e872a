"""Parsed C++ headers: one for each set of common compiler flags, whichever threads compile."""

import json
import os
import subprocess
import sys
import threading

from lissajous_env.device import headers
from lissajous_env.device.compilation import OPTIONS

_COMMON, _OTHER = OPTIONS["cpu_compiler_flags"], "-O1"


def test_threads_share_the_folder_of_the_first_for_common_flags():
    # Oracle: a folder for each thread is what Warp has by itself, and what modules of others keep.
    folder = headers.share_headers(lambda: str(threading.get_ident()))
    found = {}

    def look(name):
        found[name, "foreign"] = folder() == str(threading.get_ident())
        for flags in (_COMMON, _OTHER):
            with headers.sharing_header(flags):
                found[name, flags] = folder()

    for name in ("first", "second"):
        thread = threading.Thread(target=look, args=(name,))
        thread.start()
        thread.join()
    assert found["first", "foreign"]
    assert found["second", "foreign"]
    assert found["first", _COMMON] == found["second", _COMMON] is not None
    assert found["first", _OTHER] is found["second", _OTHER] is None


def test_a_thread_waits_for_the_header_that_another_makes(monkeypatch):
    monkeypatch.setattr(headers, "_made", set())
    monkeypatch.setattr(headers, "_making", {_COMMON: threading.Lock()})
    order, made, begins = [], threading.Event(), threading.Event()

    def compile_first():
        with headers.sharing_header(_COMMON):
            begins.set()
            made.wait(10)
            order.append("first")

    def compile_second():
        begins.wait(10)
        with headers.sharing_header(_COMMON):
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


def test_a_failed_compilation_makes_no_header(monkeypatch):
    monkeypatch.setattr(headers, "_made", set())
    try:
        with headers.sharing_header(_COMMON):
            raise ValueError
    except ValueError:
        pass
    assert headers._made == set()
    with headers.sharing_header(_COMMON):
        pass
    assert headers._made == {_COMMON}


_SCRIPT = """
import json
from pathlib import Path
import warp as wp
import warp._src.build as build
from lissajous_env.device import kernel_cache
from lissajous_env.device.devices import as_device, compile_quietly
from lissajous_env.world import clock, events, reward

as_device("cpu")
built, before = [], build.build_cpu

def build_cpu(*args, pch_dir=None, **kwargs):
    before(*args, pch_dir=pch_dir, **kwargs)
    built.append(sorted(str(path) for path in Path(pch_dir).iterdir()))

build.build_cpu = build_cpu
kernels = [next(each for each in vars(module).values() if isinstance(each, wp.Kernel))
           for module in (clock, events, reward)]
with compile_quietly():
    kernel_cache.load_together(kernels, "cpu", 2)
print(json.dumps(built))
"""


def test_modules_that_two_threads_compile_have_one_header(tmp_path):
    # Story: a first run, with an empty cache. Oracle: the files in the folder that the compiler was given.
    environment = os.environ | {"WARP_CACHE_PATH": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", _SCRIPT], env=environment, capture_output=True, text=True, check=True, timeout=300
    )
    built = json.loads(done.stdout.splitlines()[-1])
    assert len(built) == 3
    assert {len(paths) for paths in built} == {1}
    assert len({path for paths in built for path in paths}) == 1
