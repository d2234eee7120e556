// A run that is recorded once and given to every method gives what each measures at those poses.
#include "eval/studies/recorded_run.h"

#include <gtest/gtest.h>

#include "eval/studies/interaction.h"

namespace palpate::eval {
namespace {

TEST(RecordedRun, GivesEveryMethodTheSameHandAndFrame) {
  Settings settings;
  settings.quick = true;
  Context context(settings);
  const auto scene = simulated_interaction(context);
  ASSERT_TRUE(scene) << scene.error().message;
  const auto tool = context.tool(scene->shape, scene->size, 300);
  ASSERT_TRUE(tool) << tool.error().message;
  const auto path = hand_path(scene->frame, **tool, 0.2, 120);
  ASSERT_TRUE(path) << path.error().message;
  const auto run = RecordedRun::record(**tool, scene->picture, path->X_WT);
  ASSERT_TRUE(run) << run.error().message;
  auto query = query_on(scene->frame, **tool);
  for (const Method& method : all_methods()) {
    SCOPED_TRACE(method.name);
    const auto measured = run->by(method.options);
    ASSERT_TRUE(measured) << measured.error().message;
    ASSERT_EQ(measured->size(), path->X_WT.size());
    int num_in_contact = 0;
    for (std::size_t i = 0; i < measured->size(); ++i) {
      const Penetration want = query->query(path->X_WT[i], method.options);
      EXPECT_EQ((*measured)[i].volume, want.volume) << i;
      EXPECT_EQ((*measured)[i].measure_W.force, want.measure_W.force) << i;
      num_in_contact += want.volume > 0;
    }
    EXPECT_GT(num_in_contact, 60);
  }
}

}  // namespace
}  // namespace palpate::eval
