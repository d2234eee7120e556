#include "palpate/core/core.h"

#include <gtest/gtest.h>

namespace palpate {
namespace {

TEST(Result, HoldsAValueOrAnError) {
  Result<int> value(7);
  ASSERT_TRUE(value);
  EXPECT_EQ(*value, 7);
  const Result<int> error(Error{Errc::not_found, "no such tool"});
  ASSERT_FALSE(error);
  EXPECT_EQ(error.error().message, "no such tool");
}

// In Release too, and not by an exception that a caller of a library without exceptions cannot
// expect.
TEST(ResultDeathTest, WhatIsNotThereEndsTheProgramWithItsMessage) {
  Result<int> error(Error{Errc::not_found, "no such tool"});
  EXPECT_DEATH((void)error.value(), "value.*no such tool");
  EXPECT_DEATH((void)*std::move(error), "value.*no such tool");
  const Result<int> value(7);
  EXPECT_DEATH((void)value.error(), "error.*it is a value");
}

}  // namespace
}  // namespace palpate
