// A server of one page that keeps what it gets.
#pragma once

#include <gtest/gtest.h>

#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "palpate/viewer/viewer.h"
#include "tests/test_util/wait_for.h"

namespace palpate::test {

struct Watcher {
  using Json = nlohmann::ordered_json;

  explicit Watcher(ViewSource& watched) : source(watched) {}

  void poll() {
    const ViewUpdate update = source.poll(subscription);
    if (!update.frames.empty()) frame = update.frames.back();
    if (update.contact) contact = update.contact;
    if (update.surface) surface = update.surface;
    samples.insert(samples.end(), update.samples.begin(), update.samples.end());
  }
  bool until(const std::function<bool()>& condition) {
    return wait_for([&] {
      poll();
      return condition();
    });
  }
  Json state() const { return Json::parse(source.state()); }
  Result<std::string> command(const Json& json) const { return source.command(json.dump()); }
  Json marks() const {
    const auto answer = command({{"command", "marks"}});
    EXPECT_TRUE(answer) << answer.error().message;
    return answer ? Json::parse(*answer)["marks"] : Json::array();
  }
  void execute(const Json& json) const {
    const auto answer = command(json);
    EXPECT_TRUE(answer) << json << ": " << answer.error().message;
  }

  ViewSource& source;
  ViewSubscription subscription = {true, true, true, true};
  std::shared_ptr<const ViewFrame> frame;
  std::shared_ptr<const ViewContact> contact;
  std::shared_ptr<const ViewSurface> surface;
  std::vector<ViewSample> samples;
};

}  // namespace palpate::test
