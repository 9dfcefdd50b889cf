"""How the tests' programs are compiled: fast, and rounding alike on every x86-64 processor."""

ONE_ARITHMETIC = {
    "XLA_FLAGS": " ".join(
        (
            # Instructions that every x86-64 processor since 2008 has, and sums by one thread.
            *("--xla_cpu_max_isa=SSE4_2", "--xla_cpu_multi_thread_eigen=false"),
            # Compiled in some 40 % of the time that the shipped settings take.
            *("--xla_backend_optimization_level=1", "--xla_cpu_use_fusion_emitters=false"),
            "--xla_backend_extra_options=xla_cpu_disable_loop_unrolling",
            "--xla_cpu_parallel_codegen_split_count=1",
        )
    ),
    **dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NPROC"), "1"),
}
"""Environment of the tests, and of the programs that they start: one set of compiled programs serves them all."""
