"""How every kernel of the project is compiled; a module with device code calls `wp.set_module_options(OPTIONS)`."""

OPTIONS = {
    "enable_backward": False,
    # Loops of constant length stay loops: unrolled, the largest kernel would take ten times as long to compile.
    "max_unroll": 1,
    # Warp's own flags but for the vectoriser of straight-line code, which makes the motion of a car a quarter slower.
    "cpu_compiler_flags": "-march=native -fno-slp-vectorize"
    " -mllvm=-inline-threshold=9000 -mllvm=-inline-cold-callsite-threshold=3000",
}
