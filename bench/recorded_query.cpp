// The bare query at the poses and frames of a recorded run, for comparison with the loop's own
// contacts. One frame, no stiffness, one thread in real time, without other load. And the memory of
// a query by field beyond its index.
//   recorded_query RUN
//   recorded_query --memory SIDE      a block of SIDE x SIDE x SIDE spheres
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string_view>
#include <utility>
#include <vector>

#include "palpate/contact/contact.h"
#include "palpate/core/core.h"
#include "src/run/internal/pipeline.h"
#include "src/run/internal/real_time.h"
#include "src/session/internal/run_reader.h"
#include "tests/test_util/allocation_counter.h"
#include "tests/test_util/contact_scenes.h"

namespace palpate::bench {
namespace {

/// Times every query of the run that measured contact. Prints one line of JSON, microseconds.
Status time_queries(const std::filesystem::path& folder) {
  const std::filesystem::path path = folder / kRecordingFile;
  std::vector<ContactRecord> contacts;
  {
    auto reader = RunReader::open(path);
    if (!reader) return reader.error();
    for (;;) {
      const auto message = reader->next();
      if (!message) return message.error();
      if (!*message) break;
      if ((*message)->topic != kContactTopic) continue;
      const auto contact = read_contact((*message)->data);
      if (!contact) return contact.error();
      if (contact->penetration.volume > 0) contacts.push_back(*contact);
    }
  }
  auto reader = RunReader::open(path);
  if (!reader) return reader.error();
  const auto tool = reader->load_tools();
  if (!tool) return tool.error();
  const RunSetup& setup = reader->setup();
  auto parts =
      make_run_parts(ToolIndex::create(*tool), setup.streams, setup.device, setup.settings);
  if (!parts) return parts.error();
  const ContactQuery& query = parts->contact->query();
  ThreadPool pool(0);
  LatencyHistogram times;
  request_real_time(70);  // like the contact thread
  std::size_t next = 0;
  std::vector<SurfaceBlend> cameras(setup.streams.size());
  RecordedDepth frame;
  for (;;) {
    const auto got = reader->next_frame(frame);
    if (!got) return got.error();
    if (!*got) break;
    SurfaceTimeline& timeline = parts->timelines[frame.record.camera];
    timeline.push(frame.frame, frame.record.capture_time, pool);
    const SurfaceView newest = timeline.at(frame.record.capture_time).to;
    cameras[frame.record.camera] = {newest, newest, 1};
    for (; next < contacts.size() && contacts[next].frame_number <= frame.record.number; ++next) {
      const auto begin = std::chrono::steady_clock::now();
      const ContactResult result = query.measure(cameras, contacts[next].X_WT);
      const auto took = std::chrono::steady_clock::now() - begin;
      if (result.penetration.status.is_unmeasured()) return lost_backend();
      times.record(std::chrono::duration_cast<std::chrono::nanoseconds>(took).count());
    }
  }
  const LatencyHistogram::Summary s = times.summary();
  std::printf("{\"num\": %llu, \"p50\": %.3f, \"p99\": %.3f, \"p999\": %.3f, \"max\": %.3f}\n",
              static_cast<unsigned long long>(s.num), s.p50, s.p99, s.p999, s.max);
  return Done{};
}

/// Measures the memory of the index and of one query by field, for a block of equal spheres. Prints
/// one line of JSON, bytes.
Status weigh_query(int side) {
  const Tool tool = test::block_of_spheres(side);
  const auto index = ToolIndex::create(tool);
  const auto first = make_contact_query(Place::cpu(), index, FieldMethod{});
  const std::size_t before = test::num_allocated_bytes();
  const auto second = make_contact_query(Place::cpu(), index, FieldMethod{});
  const std::size_t beyond = test::num_allocated_bytes() - before;
  std::printf("{\"spheres\": %zu, \"index\": %zu, \"query\": %zu}\n", tool.spheres().size(),
              index->num_bytes(), beyond);
  return Done{};
}

}  // namespace
}  // namespace palpate::bench

int main(int argc, char** argv) {
  using namespace palpate;
  const std::string_view what = argc > 1 ? argv[1] : "";
  Status done = Error{Errc::invalid_argument, "give the folder of a run, or --memory SIDE"};
  if (what == "--memory" && argc == 3) {
    done = bench::weigh_query(std::clamp(std::atoi(argv[2]), 1, 200));
  } else if (argc == 2 && what != "--memory") {
    done = bench::time_queries(argv[1]);
  }
  if (done) return 0;
  std::fprintf(stderr, "recorded_query: %s\n", done.error().message.c_str());
  return 1;
}
