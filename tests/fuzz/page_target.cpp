// Messages of two pages beside each other on their WebSockets, and the handle that they hold. The
// input is lines: the first byte says which page sends the rest, and how long after the line
// before.
#include <cmath>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>

#include "src/devices/software/page_hand.h"
#include "src/math/internal/rotation_vector.h"
#include "src/viewer/server/page_outbox.h"
#include "src/viewer/server/view_hub.h"
#include "tests/fuzz/target.h"
#include "tests/viewer/scripted_source.h"

namespace palpate::fuzz {
namespace {

constexpr double kTick = 1e-3;  // s

/// A tool that pages hold, on a clock of the test's; B is W.
class HeldByPages final : public test::ScriptedSource {
 public:
  Status hold(std::uint64_t page) override {
    const Status status = handle_->hold(page, now_);
    if (status) has_moved_ = false;
    return status;
  }
  Status move(std::uint64_t page, const Pose& X_WT) override {
    const Status status = handle_->move(page, X_WT, now_);
    if (!status) return status;
    const Quaternion& q = X_WT.rotation;
    require(norm(X_WT.translation) <= PageHandle::kFarthest &&
                std::abs(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w - 1) < 3e-3,
            "a pose that is taken is one");
    const double most = PageHandle::kFastest * (now_ - last_time_ + PageHandle::kBunch);
    require(!has_moved_ || norm(X_WT.translation - last_p_W_) <= most * (1 + 1e-9),
            "a hand that is believed is no faster than hands are");
    has_moved_ = true;
    last_time_ = now_;
    last_p_W_ = X_WT.translation;
    return status;
  }
  void release(std::uint64_t page) override { handle_->release(page); }

  /// The handle follows, pushed by what is felt.
  void pass(int num_ticks, const Wrench& felt) {
    for (int i = 0; i < num_ticks; ++i) {
      const Pose before = state_.X_BH;
      state_.time = now_ += kTick;
      require(hand_.write(felt) && hand_.read(state_), "a hand on a page is never lost");
      const Pose& X = state_.X_BH;
      require(is_finite(X) && std::isfinite(norm(state_.V_BH.linear)) &&
                  std::isfinite(norm(state_.V_BH.angular)),
              "a handle is somewhere");
      require(norm(X.translation) <= PageHandle::limits().workspace_radius * (1 + 1e-9),
              "a handle stays in its workspace");
      require(norm(X.translation - before.translation) <= 2 * PageHand::kFastest * kTick,
              "a handle never jumps");
      require(
          norm(rotation_between(before.rotation, X.rotation)) <= 2 * PageHand::kFastestTurn * kTick,
          "a handle never turns at once");
    }
    set_time(now_ - kBegin);
  }
  double now() const { return now_; }

 private:
  static constexpr double kBegin = 100;  // s
  double now_ = kBegin, last_time_ = 0;
  Vec3d last_p_W_;  // that was told last
  bool has_moved_ = false;
  DeviceState state_;
  std::shared_ptr<PageHandle> handle_ = std::make_shared<PageHandle>();
  PageHand hand_{handle_};
};

/// Texts are JSON and say what they are; pictures may be acknowledged later or never.
void take_all(PageOutbox& page, double now) {
  for (int i = 0; i < 100; ++i) {
    const ViewMessage message = page.next(now);
    if (!message) return;
    if (!message.is_text) continue;
    const auto json = nlohmann::json::parse(*message.bytes, nullptr, false);
    require(json.is_object() && json.contains("type"), "what a page is told is JSON");
    if (json["type"] != "answer") continue;
    require(json["ok"] == true || (json["error"].is_string() && json["error"] != ""),
            "a refusal has words");
  }
  require(false, "what waits for a page has an end");
}

}  // namespace

std::vector<std::string> seeds() {
  return {
      "\x01{\"id\":1,\"command\":\"hold\"}\n\x21{\"hand\":[0,0,0.4,0,0,0,1]}\n"
      "\x21{\"hand\":[0.02,0,0.41,0,0,0.1,0.995]}\n\x02{\"id\":2,\"command\":\"hold\"}\n"
      "\x61{\"id\":3,\"command\":\"release\"}\n\x02{\"hand\":[0,0,0,0,0,0,1]}\n",
      "\x01{\"command\":\"hold\"}\n\x01{\"hand\":[0,0,0,0,0,0,1]}\n"
      "\x11{\"hand\":[1e300,0,0,0,0,0,1]}\n\x11{\"hand\":[0,0,0,0,0,0,2]}\n"
      "\x11{\"hand\":[90,0,0,0,0,0,1]}\n\x11{\"hand\":[0,null,0]}\n\xf1{\"hand\":[0.2,0,0,0,0,0,1]"
      "}",
      "\x01{\"id\":1,\"command\":\"show\",\"frames\":true,\"contacts\":true,\"surfaces\":true,"
      "\"samples\":true}\n\x31{\"ack\":1}\n\x31{\"ack\":2}\n\x32{\"ack\":18446744073709551615}\n",
      "\x02{\"id\":-1.5,\"command\":\"get\",\"what\":\"mesh\"}\n\x02{\"command\":\"get\",\"what\":"
      "\"objects\"}\n\x02[1]\n\x02{\"command\":7}\n\x02{\"id\":\"a\"}\n",
      "\x01{\"id\":4,\"command\":\"set\",\"key\":\"coupling.stiffness\",\"value\":800}\n\x01{"
      "\"command\":\"pause\"}\n\x01{\"command\":\"step\",\"frames\":2}\n\x01{\"command\":\"mark\","
      "\"text\":\"\xc3\xa4\"}\n\x01{\"command\":\"end\"}"};
}

}  // namespace palpate::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate;
  using namespace palpate::fuzz;
  HeldByPages source;
  ViewHub hub(source);
  std::unique_ptr<PageOutbox> pages[2];
  for (auto& page : pages) page = std::make_unique<PageOutbox>(hub);
  std::string_view rest = text_of(data, size);
  for (int line = 0; line < 200 && !rest.empty(); ++line) {
    const std::string_view text = rest.substr(0, rest.find('\n'));
    rest.remove_prefix(std::min(text.size() + 1, rest.size()));
    if (text.empty()) continue;
    const auto how = static_cast<unsigned char>(text.front());
    auto& page = pages[how & 1];
    if (how == 0x7f) page = std::make_unique<PageOutbox>(hub);  // it went, and another comes
    if (how == 0x7e) page->receive_binary();
    page->receive(text.substr(1));
    source.pass(1 + (how >> 4) * 4, {{(how & 2) != 0 ? 10.0 : 0.0, 0, 0}, {0, 0, 0.1}});
    if ((how & 4) != 0) continue;  // a page that does not read
    hub.poll(source.now());
    for (auto& each : pages) take_all(*each, source.now());
  }
  return 0;
}
