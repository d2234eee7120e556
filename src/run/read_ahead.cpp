#include "src/run/internal/run_inputs.h"

#include <algorithm>
#include <condition_variable>
#include <mutex>
#include <utility>
#include <vector>

#include "src/core/internal/guarded.h"
#include "src/run/internal/pipeline.h"

namespace palpate { inline namespace v0 {
namespace {

class ReadAhead final : public DepthSource {
 public:
  ReadAhead(std::unique_ptr<DepthSource> source, int num_ahead)
      : source_(std::move(source)),
        info_(source_->info()),
        frames_(static_cast<std::size_t>(num_ahead)) {}
  ~ReadAhead() override {
    cancel();
    if (thread_.joinable()) thread_.join();
  }

  Status start() {
    return start_thread(thread_, "that reads frames", [this] {
      guarded([&] { read_all(); }, [&](const Error& error) { end(error); });
    });
  }

  const DepthStreamInfo& info() const override { return info_; }

  void cancel() noexcept override {
    {
      const std::lock_guard lock(mutex_);
      is_stopping_ = true;
    }
    has_changed_.notify_all();
    source_->cancel();
  }
  std::vector<std::string> take_notes() override { return source_->take_notes(); }

  Result<bool> next(DepthFrame& frame) override {
    std::unique_lock lock(mutex_);
    has_changed_.wait(lock, [&] { return num_read_ > num_given_ || has_ended_ || is_stopping_; });
    if (is_stopping_) return false;
    if (num_read_ == num_given_) return end_;
    std::swap(frame, place(num_given_));
    ++num_given_;
    has_changed_.notify_all();
    return true;
  }

 private:
  DepthFrame& place(std::size_t number) { return frames_[number % frames_.size()]; }

  void end(const Result<bool>& how) {
    const std::lock_guard lock(mutex_);
    has_ended_ = true;
    has_changed_.notify_all();
    end_ = how;  // may need memory that there is not
  }

  void read_all() {
    take_rank(ThreadRank::frames);
    DepthFrame frame;
    for (;;) {
      const auto got = source_->next(frame);
      if (!got || !*got) return end(got);
      std::unique_lock lock(mutex_);
      has_changed_.wait(lock,
                        [&] { return num_read_ - num_given_ < frames_.size() || is_stopping_; });
      if (is_stopping_) return;
      std::swap(frame, place(num_read_));
      ++num_read_;
      has_changed_.notify_all();
    }
  }

  const std::unique_ptr<DepthSource> source_;  // of the thread, but for cancel and take_notes
  const DepthStreamInfo info_;

  std::mutex mutex_;  // of what follows
  std::condition_variable has_changed_;
  std::vector<DepthFrame> frames_;  // a ring
  std::size_t num_read_ = 0, num_given_ = 0;
  Result<bool> end_ = false;  // last result of the source
  bool has_ended_ = false, is_stopping_ = false;

  std::thread thread_;
};

}  // namespace

Result<std::unique_ptr<DepthSource>> read_ahead(std::unique_ptr<DepthSource> source,
                                                int num_ahead) {
  auto reader = std::make_unique<ReadAhead>(std::move(source), std::max(num_ahead, 1));
  if (const Status started = reader->start(); !started) return started.error();
  return std::unique_ptr<DepthSource>(std::move(reader));
}

}}  // namespace palpate::v0
