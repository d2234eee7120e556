// Reads a recorded run.
#include <algorithm>
#include <list>
#include <utility>

#include "src/session/internal/run_folder.h"
#include "src/session/internal/run_reader.h"
#include "src/viewer/protocol/samples.h"
#include "src/viewer/sources/mcap_index.h"

namespace palpate { inline namespace v0 {
namespace fs = std::filesystem;
namespace {

constexpr std::size_t kMaxChunks = 16;  // in memory, some hundred kilobytes each
constexpr double kRounding = 1e-6;      // s; the times of messages are whole numbers of ns

struct KnownQuery {
  double time = 0;
  CameraBlends cameras;
  Pose X_WT;
  std::uint64_t frame_number = 0;
  std::uint32_t revision = 0;
  std::vector<Pose> bodies;
};

/// Queries and samples of a chunk, in order.
struct ChunkContent {
  std::vector<KnownQuery> queries;
  std::vector<ViewSample> samples;
};

/// Summary of a chunk, kept so that it is not read again for data that it does not hold.
struct ChunkSummary {
  bool has_queries = false;
  double first_query = 0;  ///< its time
  std::uint64_t newest_frame = 0;
};

class RunInFile final : public RecordedRun {
 public:
  RunInFile(Tool tool, std::unique_ptr<McapIndex> index, RunReader reader)
      : tool_(std::move(tool)), index_(std::move(index)), reader_(std::move(reader)) {}

  const Tool& tool() const override { return tool_; }
  const std::vector<DepthStreamInfo>& streams() const override { return index_->setup().streams; }
  const std::vector<SceneObject>& objects() const override {
    return reader_.setup().settings.objects;
  }
  RunSettings settings(std::uint32_t revision) override { return *index_->settings(revision); }
  double duration() override { return index_->duration(); }
  std::size_t num_frames() override { return index_->num_frames(); }
  std::uint64_t frame_number(std::size_t index) override { return index_->frame(index).number; }
  std::pair<std::size_t, std::int64_t> camera_frame(std::size_t index) override {
    const IndexedFrame frame = index_->frame(index);
    return {frame.camera, frame.camera_frame};
  }
  double period_after(std::size_t index) override { return index_->frame(index).period; }
  double needed_from(std::size_t index) override;
  Result<RecordedFrame> read_frame(std::size_t index) override;
  Result<RecordedQuery> query_at(double time) override;
  Result<std::vector<ViewSample>> samples(double after, double until) override;
  Result<std::optional<double>> first_touch(double until) override;
  std::vector<RecordedMark> marks() const override { return index_->marks(); }
  std::size_t num_marks() const override { return index_->num_marks(); }
  std::string note() override { return index_->note(); }

 private:
  Result<const ChunkContent*> content(std::size_t chunk);
  Result<ChunkContent> read_content(std::uint64_t place);
  void summarize(std::size_t chunk, const ChunkContent& content);
  /// True if a chunk may hold the data, or has not been read yet.
  template <class Holds>
  bool may_hold(std::size_t chunk, Holds holds) const {
    const bool is_known = chunk < summaries_.size() && summaries_[chunk];
    return !is_known || (summaries_[chunk]->has_queries && holds(*summaries_[chunk]));
  }

  Tool tool_;
  std::unique_ptr<McapIndex> index_;
  RunReader reader_;
  // Contents of chunks, the last used one in front; for a damaged one, the error.
  std::list<std::pair<std::size_t, Result<ChunkContent>>> contents_;
  std::vector<std::optional<ChunkSummary>> summaries_;  // of chunks that were read
};

Result<ChunkContent> RunInFile::read_content(std::uint64_t place) {
  ChunkContent content;
  if (const Status found = reader_.seek(place); !found) return found.error();
  for (;;) {
    const auto message = reader_.next();
    if (!message) return message.error();
    if (!*message || reader_.chunk_place() != place) return content;
    const std::string_view topic = (*message)->topic;
    if (topic == kTickTopic) {
      const auto tick = read_tick((*message)->data);
      if (!tick) return tick.error();
      const CouplingKind kind = index_->settings(tick->revision)->coupling.kind;
      content.samples.push_back(sample_of(*tick, kind != CouplingKind::none));
    } else if (topic == kContactTopic) {
      const auto query = read_contact((*message)->data);
      if (!query) return query.error();
      const auto& [num, poses] = query->bodies;
      content.queries.push_back({query->time,
                                 query->cameras,
                                 query->X_WT,
                                 query->frame_number,
                                 query->revision,
                                 {poses, poses + num}});
    }
  }
}

Result<const ChunkContent*> RunInFile::content(std::size_t chunk) {
  auto known = std::find_if(contents_.begin(), contents_.end(),
                            [&](const auto& entry) { return entry.first == chunk; });
  if (known == contents_.end()) {
    auto content = read_content(index_->chunk(chunk).place);
    if (!content && content.error().code != Errc::bad_input) return content.error();
    if (content) summarize(chunk, *content);
    // The last chunk known by now may be indexed only in part: no matter.
    contents_.emplace_front(chunk, std::move(content));
    if (contents_.size() > kMaxChunks) contents_.pop_back();
  } else {
    contents_.splice(contents_.begin(), contents_, known);
  }
  const Result<ChunkContent>& used = contents_.front().second;
  if (!used) return used.error();
  return &*used;
}

void RunInFile::summarize(std::size_t chunk, const ChunkContent& content) {
  ChunkSummary summary;
  for (const KnownQuery& query : content.queries) {
    summary.newest_frame = std::max(summary.newest_frame, query.frame_number);
  }
  summary.has_queries = !content.queries.empty();
  if (summary.has_queries) summary.first_query = content.queries.front().time;
  if (summaries_.size() <= chunk) summaries_.resize(chunk + 1);
  summaries_[chunk] = summary;
}

Result<RecordedFrame> RunInFile::read_frame(std::size_t index) {
  const IndexedFrame desired = index_->frame(index);
  const Error gone{Errc::bad_input, "a depth frame of the recording is gone; was it changed?"};
  FrameJoiner joiner(index_->setup().streams);
  if (const Status found = reader_.seek(desired.place); !found) return found.error();
  for (;;) {
    const auto message = reader_.next();
    if (!message) return message.error();
    if (!*message) return gone;
    auto joined = joiner.take((*message)->topic, (*message)->data);
    if (!joined) return joined.error();
    if ((*message)->topic == kFrameTopic) {
      const auto record = v0::read_frame((*message)->data);
      if (record && record->number > desired.number) return gone;  // its image is missing
    }
    if (!*joined || (*joined)->record.number != desired.number) continue;
    DepthFrame& frame = (*joined)->frame;
    return RecordedFrame{
        {desired.number, desired.capture_time - index_->start(), std::move(frame), desired.camera},
        desired.capture_time};
  }
}

Result<RecordedQuery> RunInFile::query_at(double time) {
  const KnownQuery* found = nullptr;
  std::size_t chunk = index_->chunk_at(time + kRounding);
  const auto begins_by_then = [&](const ChunkSummary& s) { return !(time < s.first_query); };
  for (;; --chunk) {
    if (may_hold(chunk, begins_by_then)) {
      const auto content = this->content(chunk);
      if (!content) return content.error();
      const auto& queries = (*content)->queries;
      const auto next = std::upper_bound(queries.begin(), queries.end(), time,
                                         [](double t, const KnownQuery& q) { return t < q.time; });
      if (next != queries.begin()) found = &*std::prev(next);
    }
    if (found != nullptr || chunk == 0) break;
  }
  for (; found == nullptr && chunk < index_->num_chunks(); ++chunk) {
    if (!may_hold(chunk, [](const ChunkSummary&) { return true; })) continue;
    const auto content = this->content(chunk);
    if (!content) return content.error();
    if (!(*content)->queries.empty()) found = &(*content)->queries.front();
  }
  if (found == nullptr) return Error{Errc::bad_input, "the recording has no contact query"};
  return RecordedQuery{found->time,    found->time + index_->start(),
                       found->X_WT,    index_->index_of(found->frame_number),
                       found->cameras, found->bodies,
                       found->revision};
}

/// Surfaces come late: the frame was captured, made into one, and waited for the blend before.
double RunInFile::needed_from(std::size_t index) {
  const IndexedFrame frame = index_->frame(index);
  const double captured = frame.capture_time - index_->start();
  constexpr double kLongest = 2;  // s
  const auto is_of_frame = [&](const ChunkSummary& s) { return s.newest_frame >= frame.number; };
  for (std::size_t chunk = index_->chunk_at(captured);
       chunk < index_->num_chunks() && index_->chunk(chunk).first < captured + kLongest; ++chunk) {
    if (!may_hold(chunk, is_of_frame)) continue;
    const auto content = this->content(chunk);
    if (!content) break;
    for (const KnownQuery& query : (*content)->queries) {
      if (query.frame_number >= frame.number) return query.time;
    }
  }
  return std::clamp(captured, 0.0, duration());
}

Result<std::vector<ViewSample>> RunInFile::samples(double after, double until) {
  std::vector<ViewSample> samples;
  if (until <= after) return samples;
  std::size_t chunk = index_->chunk_at(after);
  // Ticks and queries of one moment may be in neighboring chunks.
  if (chunk > 0) --chunk;
  for (; chunk < index_->num_chunks() && index_->chunk(chunk).first <= until + kRounding; ++chunk) {
    if (index_->chunk(chunk).last < after - kRounding) continue;
    const auto content = this->content(chunk);
    if (!content) return content.error();
    for (const ViewSample& sample : (*content)->samples) {
      if (sample.time > after && sample.time <= until) samples.push_back(sample);
    }
  }
  return samples;
}

Result<std::optional<double>> RunInFile::first_touch(double until) {
  until += kRounding;
  for (std::size_t chunk = 0; chunk < index_->num_chunks() && index_->chunk(chunk).first <= until;
       ++chunk) {
    const auto content = this->content(chunk);
    if (!content) return content.error();
    for (const ViewSample& sample : (*content)->samples) {
      if (sample.volume > 0 && sample.time <= until) return std::optional(sample.time);
    }
  }
  return std::optional<double>();
}

}  // namespace

Result<std::unique_ptr<RecordedRun>> open_recorded_run(const fs::path& folder) {
  auto reader = RunReader::open(folder);
  if (!reader) return reader.error();
  auto tool = reader->load_tools();
  if (!tool) return tool.error();
  auto index = McapIndex::open(folder);
  if (!index) return index.error();
  return std::unique_ptr<RecordedRun>(
      std::make_unique<RunInFile>(*std::move(tool), *std::move(index), *std::move(reader)));
}

}}  // namespace palpate::v0
