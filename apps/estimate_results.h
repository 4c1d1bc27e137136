// Results of `raylift estimate` for pose problems, and the files that hold them.

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

// The object of a problem in --json. It holds all that the other files are made of, so that a
// manifest may keep it.
using EstimateRow = nlohmann::ordered_json;
// Returns the row of a problem that is read from `file`.
EstimateRow MakeEstimateRow(const std::string& name, const std::string& file, Method method,
                            const PoseEstimate& estimate, double time_ms);

std::string FormatEstimatesCsv(std::span<const EstimateRow> rows);
std::string FormatEstimatesJson(std::span<const EstimateRow> rows);
std::vector<NamedPose> PosesOf(std::span<const EstimateRow> rows);
// Prints on stdout the problems without a pose, with their reasons, and how many have one.
void PrintEstimates(std::span<const EstimateRow> rows);

// Returns the form of `estimate --out` as a job, whose tasks are files of problems.
JobForm EstimateJobForm();
// Returns the manifest's line of a file that is done.
std::string EstimateLine(size_t place, const std::string& key, const EstimateRow& row);
// Returns the rows in the order of the files.
std::vector<EstimateRow> EstimateRowsOf(const TaskManifest& manifest);

// Writes the poses. Throws InputError where two problems have the same name, as a pose file has
// each name once.
void WriteEstimatedPoses(const std::filesystem::path& file, std::span<const EstimateRow> rows);
// Writes the files of --out; run times go to a file of their own.
void WriteEstimates(const std::filesystem::path& out, std::span<const EstimateRow> rows);
TaskManifest WithoutTimes(TaskManifest manifest);

}  // namespace raylift
