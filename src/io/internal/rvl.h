// Depth images as counts, compressed by runs of zeros and differences (Wilson, Fast Lossless Depth
// Image Compression, ISS 2017), as ROS's compressedDepth sends them.
#pragma once

#include <string_view>

#include "palpate/cloud/depth_source.h"

namespace palpate { inline namespace v0 {

/// Width and height, uint32 little-endian; then 32-bit little-endian words of eight nibbles each,
/// the highest first. A nibble holds three bits of a number, the lowest first, and whether more
/// follow. Numbers are, in turn: how many zeros, how many others, and of each other one its
/// difference to the one before, with the sign in the lowest bit. Errors: damaged; memory is
/// bounded by the limits of images. `what`: whose image it is, for errors. DepthFrame::timestamp is
/// 0.
Result<DepthFrame> decode_depth_rvl(std::string_view data, std::string_view what, double unit);

}}  // namespace palpate::v0
