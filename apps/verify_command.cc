// raylift verify: whether rendered files are still as they were written.

#include <memory>

#include "commands.h"
#include "options.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/jobs/job_status.h"
#include "raylift/views/verify.h"

namespace raylift {
namespace {

void Verify(const std::filesystem::path& out, const RunFlags& run) {
  const JobStatus status = ReadJobStatus(out);
  if (status.command != "render") {
    throw InputError(
        out, fmt::format("is of `raylift {}`: only rendered files have checksums", status.command));
  }
  const Verification found = VerifyRenderedFiles(out, run.threads);
  for (const FileFault& fault : found.faults) fmt::print("{} {}\n", fault.file, fault.what);
  if (!found.faults.empty()) {
    throw InputError(out,
                     fmt::format("{} of {} files are not as they were written; render --resume "
                                 "makes them anew",
                                 found.faults.size(), found.files));
  }
  if (run.quiet) return;
  fmt::print("{} images, {} files, {:.1f} MB: all are as they were written\n", found.images,
             found.files, 1e-6 * static_cast<double>(found.bytes));
}

}  // namespace

Command AddVerifyCommand(CLI::App& program) {
  struct Flags {
    std::filesystem::path out;
    RunFlags run;
  };
  auto flags = std::make_shared<Flags>();
  CLI::App* command = program.add_subcommand(
      "verify", "Whether the files of render are still as they were written (checksums)");
  command->add_option("OUT", flags->out, "The folder of --out")->required();
  AddRunOptions(*command, flags->run);
  command->footer(
      "Prints the files that are missing or have other contents; the exit code then is 3.\n"
      "The manifest's checksums are those of `xxhsum -H3`.\n"
      "Example:\n"
      "  raylift verify rendered");
  return {command, [flags] {
            flags->run.Check();
            Verify(flags->out, flags->run);
          }};
}

}  // namespace raylift
