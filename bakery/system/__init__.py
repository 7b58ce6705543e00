"""What the machine offers: LLVM, memory, threads, the terminal."""
