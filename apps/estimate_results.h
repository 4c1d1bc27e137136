// What came out for the pose problems of `raylift estimate`, and its files.

#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "raylift/estimation/options.h"
#include "raylift/estimation/pose_estimator.h"
#include "raylift/io/query_list.h"
#include "raylift/jobs/task_job.h"

namespace raylift {

// An object of --json: all that the other files are made of, so that a manifest may keep it.
using EstimateRow = nlohmann::ordered_json;
// `file`: where the problem stands.
EstimateRow MakeEstimateRow(const std::string& name, const std::string& file, Method method,
                            const PoseEstimate& estimate, double time_ms);

std::string FormatEstimatesCsv(std::span<const EstimateRow> rows);
std::string FormatEstimatesJson(std::span<const EstimateRow> rows);
std::vector<NamedPose> PosesOf(std::span<const EstimateRow> rows);
// On stdout: those without a pose, with their reasons, and how many have one.
void PrintEstimates(std::span<const EstimateRow> rows);

// `estimate --out` as a job, whose tasks are files of problems.
JobForm EstimateJobForm();
// The line of a file that is done.
std::string EstimateLine(size_t place, const std::string& key, const EstimateRow& row);
// In the order of the files.
std::vector<EstimateRow> EstimateRowsOf(const TaskManifest& manifest);

// InputError where two problems have one name, as a pose file has it once.
void WriteEstimatedPoses(const std::filesystem::path& file, std::span<const EstimateRow> rows);
// The files of --out: what the rows tell of times is in one of its own.
void WriteEstimates(const std::filesystem::path& out, std::span<const EstimateRow> rows);
TaskManifest WithoutTimes(TaskManifest manifest);

}  // namespace raylift
