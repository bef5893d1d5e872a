"""Building blocks of kernels (the curve, random numbers, structs), their compilation and their launches."""
