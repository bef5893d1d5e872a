"""What kernels are built of: the curve, random numbers, structs, and how all of it is compiled and launched."""
