#include "job_options.h"

#include "raylift/base/error.h"

namespace raylift {

void JobFlags::Check() const {
  if (resume && overwrite) throw OptionError("give at most one of --resume and --overwrite");
}

Shard JobFlags::Resolve() const { return ParseShard(shard, &EnvironmentVariable); }

JobFolder JobFlags::In(const std::filesystem::path& out) const {
  return {.out = out, .shard = Resolve(), .resume = resume, .overwrite = overwrite};
}

void AddOverwriteOption(CLI::App& app, bool& overwrite) {
  app.add_flag("--overwrite", overwrite,
               "Begin anew in a folder where a finished run is; else it is refused")
      ->group("Running");
}

void RefuseFinished(const std::filesystem::path& file, bool overwrite) {
  std::error_code ignored;
  if (overwrite || !std::filesystem::exists(file, ignored)) return;
  throw OptionError("--overwrite", "false",
                    file.string() + " is of a finished run, which would be lost");
}

void AddJobOptions(CLI::App& app, JobFlags& flags, const std::string& resume,
                   const std::string& overwrite) {
  const std::string group = "Running";
  app.add_flag("--resume", flags.resume, resume)->group(group);
  app.add_flag("--overwrite", flags.overwrite, overwrite)->group(group);
  app.add_option("--shard", flags.shard,
                 "i/n: only the i-th of n equal parts (i from 0 or from 1: n/n is 0/n);\n"
                 "auto: what the environment tells of job arrays (Slurm, SGE, AWS Batch), of\n"
                 "tasks of srun, MPI or RANK and WORLD_SIZE, or of both at once; auto/N where\n"
                 "it does not tell of how many an array's index is one, from 0 (PBS,\n"
                 "Kubernetes, uneven arrays, one job submitted again)")
      ->capture_default_str()
      ->group(group);
}

}  // namespace raylift
