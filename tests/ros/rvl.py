"""Compresses depth by runs of zeros and differences, as A. D. Wilson describes it (Fast Lossless Depth Image
Compression, 2017) and compressedDepth of ROS sends it."""

import struct


def numbers_of(counts):
    """Encodes each run: number of zeros, number of others, and the others' differences with their sign last."""
    numbers, before, at = [], 0, 0
    while at < len(counts):
        end = at
        while end < len(counts) and counts[end] == 0:
            end += 1
        numbers.append(end - at)
        begin = at = end
        while at < len(counts) and counts[at] != 0:
            at += 1
        numbers.append(at - begin)
        for count in counts[begin:at]:
            difference, before = count - before, count
            numbers.append(2 * difference if difference >= 0 else -2 * difference - 1)
    return numbers


def compressed(counts, width, height):
    digits = ""
    for number in numbers_of([int(count) for count in counts]):
        octal = oct(number)[2:]
        digits += "".join(format(int(digit) + 8, "x") for digit in octal[:0:-1]) + octal[0]
    digits += "0" * (-len(digits) % 8)
    words = [int(digits[at:at + 8], 16) for at in range(0, len(digits), 8)]
    return struct.pack(f"<II{len(words)}I", width, height, *words)
