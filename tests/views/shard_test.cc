#include "raylift/views/shard.h"

#include <map>
#include <string>

#include <gtest/gtest.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

using Variables = std::map<std::string, std::string>;

Shard Parse(const std::string& text, const Variables& variables = {}) {
  return ParseShard(text, [&variables](const std::string& name) -> std::optional<std::string> {
    const auto found = variables.find(name);
    return found != variables.end() ? std::optional(found->second) : std::nullopt;
  });
}

TEST(Shard, CountsFromZeroAsFromOne) {
  EXPECT_EQ(Parse("0/4"), (Shard{0, 4}));
  EXPECT_EQ(Parse("1/4"), (Shard{1, 4}));
  EXPECT_EQ(Parse("4/4"), (Shard{0, 4}));
  EXPECT_TRUE(Parse("1/1").IsAll());
  EXPECT_TRUE(Parse("0/1").IsAll());
}

TEST(Shard, EveryNameIsInExactlyOneAndPartsAreOfLikeSize) {
  constexpr int kParts = 7;
  std::map<int, int> count;
  for (int i = 0; i < 7000; ++i) {
    const std::string name = "camera/" + std::to_string(i) + ".jpg";
    int parts = 0;
    for (int part = 0; part < kParts; ++part) {
      if (Shard{part, kParts}.Contains(name)) {
        ++parts;
        ++count[part];
      }
    }
    EXPECT_EQ(parts, 1);
  }
  for (const auto& [part, names] : count) EXPECT_NEAR(names, 1000, 150) << part;
}

TEST(Shard, AutoReadsTheSchedulersVariables) {
  EXPECT_EQ(Parse("auto", {{"SLURM_ARRAY_TASK_ID", "0"}, {"SLURM_ARRAY_TASK_COUNT", "8"}}),
            (Shard{0, 8}));
  EXPECT_EQ(Parse("auto", {{"SLURM_ARRAY_TASK_ID", "107"},
                           {"SLURM_ARRAY_TASK_COUNT", "8"},
                           {"SLURM_ARRAY_TASK_MIN", "100"}}),
            (Shard{7, 8}));
  EXPECT_EQ(Parse("auto", {{"SLURM_ARRAY_TASK_ID", "9"},
                           {"SLURM_ARRAY_TASK_COUNT", "5"},
                           {"SLURM_ARRAY_TASK_MIN", "1"},
                           {"SLURM_ARRAY_TASK_STEP", "2"}}),
            (Shard{4, 5}));
  EXPECT_EQ(Parse("auto", {{"SLURM_PROCID", "3"}, {"SLURM_NTASKS", "4"}}), (Shard{3, 4}));
  EXPECT_EQ(Parse("auto", {{"OMPI_COMM_WORLD_RANK", "1"},
                           {"OMPI_COMM_WORLD_SIZE", "2"},
                           {"SLURM_PROCID", "0"},
                           {"SLURM_NTASKS", "1"}}),
            (Shard{1, 2}));
}

TEST(Shard, WhatMakesNoSenseIsAnError) {
  for (const char* text : {"", "3", "5/4", "-1/4", "1/0", "a/b", "1/2/3", "1/4x"}) {
    EXPECT_THROW(Parse(text), OptionError) << text;
  }
  EXPECT_THROW(Parse("auto"), OptionError);
  EXPECT_THROW(Parse("auto", {{"SLURM_PROCID", "3"}}), OptionError);
  EXPECT_THROW(Parse("auto", {{"SLURM_PROCID", "5"}, {"SLURM_NTASKS", "4"}}), OptionError);
  EXPECT_THROW(Parse("auto", {{"SLURM_ARRAY_TASK_ID", "x"}, {"SLURM_ARRAY_TASK_COUNT", "4"}}),
               OptionError);
}

}  // namespace
}  // namespace raylift
