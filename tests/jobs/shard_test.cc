#include "raylift/jobs/shard.h"

#include <map>
#include <set>
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

TEST(Shard, EveryImageIsInExactlyOneAndPartsDifferByOneAtMost) {
  constexpr int kParts = 7;
  std::map<int, int> count;
  for (size_t position = 0; position < 37; ++position) {
    int parts = 0;
    for (int part = 0; part < kParts; ++part) {
      if (Shard{part, kParts}.Contains(position)) {
        ++parts;
        ++count[part];
      }
    }
    EXPECT_EQ(parts, 1);
  }
  for (const auto& [part, images] : count) EXPECT_EQ(images, part < 2 ? 6 : 5) << part;
}

// What Slurm sets for `--array=FIRST-LAST:STEP` of so many tasks.
Variables SlurmArray(int id, int count, int first, int last, int step = 1) {
  return {{"SLURM_ARRAY_TASK_ID", std::to_string(id)},
          {"SLURM_ARRAY_TASK_COUNT", std::to_string(count)},
          {"SLURM_ARRAY_TASK_MIN", std::to_string(first)},
          {"SLURM_ARRAY_TASK_MAX", std::to_string(last)},
          {"SLURM_ARRAY_TASK_STEP", std::to_string(step)},
          {"SLURM_PROCID", "0"}};
}

// What srun sets for each of its tasks.
Variables SlurmStep(int index, int count) {
  return {{"SLURM_PROCID", std::to_string(index)},
          {"SLURM_NTASKS", std::to_string(count)},
          {"SLURM_STEP_NUM_TASKS", std::to_string(count)}};
}

Variables With(Variables some, const Variables& more) {
  for (const auto& [name, value] : more) some[name] = value;
  return some;
}

// The error's text; empty where there is none.
std::string Complaint(const std::string& text, const Variables& variables) {
  try {
    Parse(text, variables);
  } catch (const OptionError& error) {
    return error.what();
  }
  return {};
}

void ExpectRefused(const std::string& text, const Variables& variables, const std::string& part) {
  const std::string complaint = Complaint(text, variables);
  EXPECT_NE(complaint.find(part), std::string::npos) << '"' << complaint << "\", wanted " << part;
}

TEST(AutoShard, EvenlySpacedSlurmArrays) {
  EXPECT_EQ(Parse("auto", SlurmArray(0, 8, 0, 7)), (Shard{0, 8}));
  EXPECT_EQ(Parse("auto", SlurmArray(107, 8, 100, 107)), (Shard{7, 8}));
  EXPECT_EQ(Parse("auto", SlurmArray(9, 5, 1, 9, 2)), (Shard{4, 5}));
}

TEST(AutoShard, UnevenSlurmArraysAreRefusedWithTheWayOut) {
  for (const int id : {1, 5, 9}) {
    ExpectRefused("auto", SlurmArray(id, 3, 1, 9), "auto/N");
    EXPECT_EQ(Parse("auto/10", SlurmArray(id, 3, 1, 9)), (Shard{id, 10}));
  }
  // --array=3,5: both tasks once took shard 0.
  ExpectRefused("auto", SlurmArray(3, 2, 3, 5), "not evenly spaced");
  ExpectRefused("auto", SlurmArray(5, 2, 3, 5), "not evenly spaced");
  // Regular in numbers alone: 0, 1, 8 by the step of 0 and 4.
  ExpectRefused("auto", SlurmArray(1, 3, 0, 8, 4), "not evenly spaced");
  ExpectRefused("auto", {{"SLURM_ARRAY_TASK_ID", "1"}, {"SLURM_ARRAY_TASK_COUNT", "4"}},
                "does not tell of which");
  ExpectRefused("auto/5", SlurmArray(5, 3, 1, 9), "SLURM_ARRAY_TASK_ID = 5 is not below 5");
}

TEST(AutoShard, OneTaskSubmittedAgainDoesNotTakeTheWholeList) {
  ExpectRefused("auto", SlurmArray(5, 1, 5, 5), "one task");
  EXPECT_EQ(Parse("auto/10", SlurmArray(5, 1, 5, 5)), (Shard{5, 10}));
}

TEST(AutoShard, TasksOfSrun) {
  EXPECT_EQ(Parse("auto", SlurmStep(3, 4)), (Shard{3, 4}));
  EXPECT_EQ(Parse("auto/4", SlurmStep(3, 4)), (Shard{3, 4}));
  ExpectRefused("auto/5", SlurmStep(3, 4), "4 tasks");
  ExpectRefused("auto", SlurmStep(4, 4), "is not below 4");
}

TEST(AutoShard, ABatchScriptOfSeveralTasksNeedsSrun) {
  ExpectRefused("auto", {{"SLURM_PROCID", "0"}, {"SLURM_NTASKS", "2"}}, "srun");
  // As when the job was submitted from within a step.
  ExpectRefused("auto", With(SlurmStep(0, 4), {{"SLURM_NTASKS", "2"}}), "disagree");
  EXPECT_EQ(Parse("auto", {{"SLURM_PROCID", "0"}, {"SLURM_NTASKS", "1"}}), (Shard{0, 1}));
  ExpectRefused("auto", {{"SLURM_PROCID", "3"}}, "srun");
}

TEST(AutoShard, AnArrayOfStepsGivesEveryTaskAShardOfItsOwn) {
  std::set<int> shards;
  for (const int job : {0, 1}) {
    for (const int task : {0, 1}) {
      const Shard shard = Parse("auto", With(SlurmArray(job, 2, 0, 1), SlurmStep(task, 2)));
      EXPECT_EQ(shard.count, 4);
      shards.insert(shard.index);
    }
  }
  EXPECT_EQ(shards, (std::set<int>{0, 1, 2, 3}));
  EXPECT_EQ(Parse("auto/5", With(SlurmArray(4, 2, 1, 4), SlurmStep(1, 2))), (Shard{9, 10}));
}

TEST(AutoShard, TasksOfMpi) {
  const Variables open_mpi = {{"OMPI_COMM_WORLD_RANK", "1"}, {"OMPI_COMM_WORLD_SIZE", "2"}};
  EXPECT_EQ(Parse("auto", open_mpi), (Shard{1, 2}));
  EXPECT_EQ(Parse("auto", With(open_mpi, {{"PMIX_RANK", "1"}})), (Shard{1, 2}));
  ExpectRefused("auto", With(open_mpi, {{"PMIX_RANK", "0"}}), "two things");
  EXPECT_EQ(Parse("auto", {{"PMI_RANK", "2"}, {"PMI_SIZE", "3"}}), (Shard{2, 3}));
  ExpectRefused("auto", {{"PMI_RANK", "3"}, {"PMI_SIZE", "3"}}, "is not below 3");
  ExpectRefused("auto", {{"PMIX_RANK", "2"}}, "auto/N");
  EXPECT_EQ(Parse("auto/3", {{"PMIX_RANK", "2"}}), (Shard{2, 3}));
  EXPECT_EQ(Parse("auto", With(SlurmStep(2, 3), {{"PMIX_RANK", "2"}})), (Shard{2, 3}));
  EXPECT_EQ(Parse("auto", With(open_mpi, SlurmArray(3, 4, 0, 3))), (Shard{7, 8}));
}

TEST(AutoShard, RanksCountWhereSrunHasStartedMpirunsHelpers) {
  const Variables rank = {{"OMPI_COMM_WORLD_RANK", "5"}, {"OMPI_COMM_WORLD_SIZE", "8"}};
  EXPECT_EQ(Parse("auto", With(rank, SlurmStep(1, 2))), (Shard{5, 8}));
  EXPECT_EQ(Parse("auto", With(rank, {{"SLURM_PROCID", "0"}, {"SLURM_NTASKS", "8"}})),
            (Shard{5, 8}));
  // Four tasks, each with a run of its own: all of them would be rank 0.
  const Variables alone = {{"OMPI_COMM_WORLD_RANK", "0"}, {"OMPI_COMM_WORLD_SIZE", "1"}};
  ExpectRefused("auto", With(alone, SlurmStep(2, 4)), "two things");
}

TEST(AutoShard, RankAndWorldSize) {
  const Variables rank = {{"RANK", "1"}, {"WORLD_SIZE", "4"}};
  EXPECT_EQ(Parse("auto", rank), (Shard{1, 4}));
  EXPECT_EQ(Parse("auto", With(rank, SlurmStep(1, 4))), (Shard{1, 4}));
  EXPECT_EQ(Parse("auto", With(SlurmStep(1, 4), {{"RANK", "7"}})), (Shard{1, 4}));
  ExpectRefused("auto", {{"RANK", "1"}}, "found none");
  // Scripts set them from the array's index: to multiply would lose most shards.
  ExpectRefused("auto", With(rank, SlurmArray(1, 4, 0, 3)), "RANK");
}

TEST(AutoShard, OtherArrays) {
  const Variables sge = {{"SGE_TASK_ID", "7"},
                         {"SGE_TASK_FIRST", "1"},
                         {"SGE_TASK_LAST", "9"},
                         {"SGE_TASK_STEPSIZE", "2"}};
  EXPECT_EQ(Parse("auto", sge), (Shard{3, 5}));
  ExpectRefused("auto", {{"SGE_TASK_ID", "undefined"}}, "found none");
  EXPECT_EQ(Parse("auto", {{"AWS_BATCH_JOB_ARRAY_INDEX", "2"}, {"AWS_BATCH_JOB_ARRAY_SIZE", "5"}}),
            (Shard{2, 5}));
  for (const std::string name :
       {"PBS_ARRAY_INDEX", "PBS_ARRAYID", "JOB_COMPLETION_INDEX", "AWS_BATCH_JOB_ARRAY_INDEX"}) {
    ExpectRefused("auto", {{name, "2"}}, "auto/N");
    EXPECT_EQ(Parse("auto/6", {{name, "2"}}), (Shard{2, 6})) << name;
    ExpectRefused("auto/6", {{name, "6"}}, "not below 6");
  }
  ExpectRefused("auto/6", {{"PBS_ARRAY_INDEX", "2"}, {"JOB_COMPLETION_INDEX", "2"}}, "two things");
}

TEST(AutoShard, WithoutALauncherThereIsNoShard) {
  ExpectRefused("auto", {}, "found none of SLURM_ARRAY_TASK_ID");
  ExpectRefused("auto/4", {}, "found none");
  ExpectRefused("auto", With(SlurmArray(1, 4, 0, 3), {{"SLURM_ARRAY_TASK_COUNT", "x"}}),
                "SLURM_ARRAY_TASK_COUNT");
}

TEST(Shard, WhatMakesNoSenseIsAnError) {
  for (const char* text :
       {"", "3", "5/4", "-1/4", "1/0", "a/b", "1/2/3", "1/4x", "auto/0", "auto/x", "auto/2/3"}) {
    EXPECT_THROW(Parse(text), OptionError) << text;
  }
}

}  // namespace
}  // namespace raylift
