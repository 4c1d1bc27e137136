// Preloaded into the program (LD_PRELOAD), it makes one call fail that hardly ever fails by itself:
//   RAYLIFT_FAULT_CALL    memory|read|write|create|rename|sync|map|thread|power
//   RAYLIFT_FAULT_AT      which of them, from 1; 0: none
//   RAYLIFT_FAULT_REPORT  file for how many there were, written when main ends
//   RAYLIFT_FAULT_STACKS  file for the call stacks they came from, a name a line, written then, too
//   RAYLIFT_FAULT_STACK   name of the stack of which the first call fails, instead of AT
//   RAYLIFT_FAULT_JOURNAL file for what was synced, renamed and made, a line each: of power
// Of power the process ends instead of the chosen sync, rename or making of a folder.
// It counts from main's beginning to its end. Of memory it counts what the program asks for itself
// or through the standard library, and not what other libraries do: some of them end the process
// where they get none (faults_test.py says which). Linux with the GNU C library alone.

#include <atomic>
#include <cerrno>
#include <climits>
#include <csignal>
#include <cstdarg>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <new>

#include <dlfcn.h>
#include <fcntl.h>
#include <link.h>
#include <pthread.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>
#include <unwind.h>

extern "C" {
void* __libc_malloc(size_t size);
void* __libc_memalign(size_t alignment, size_t size);
}

namespace {

enum class Call { kNone, kMemory, kRead, kWrite, kCreate, kRename, kSync, kMap, kThread, kPower };

Call chosen = Call::kNone;
long fails_at = 0;
std::atomic<long> count = 0;
std::atomic<bool> in_main = false;

// Where the program's and the standard library's code lies.
struct Code {
  uintptr_t begin = 0;
  uintptr_t end = 0;
};
Code own_code[2];
int num_own = 0;

// An address as it is in every run, wherever the loader has put the code; 0 where that is
// another's.
uint64_t OwnPlace(uintptr_t address) {
  for (int i = 0; i < num_own; ++i) {
    const Code& code = own_code[i];
    if (address >= code.begin && address < code.end) {
      return (static_cast<uint64_t>(i + 1) << 40) + (address - code.begin);
    }
  }
  return 0;
}

// A hash of the return addresses of the innermost own functions.
struct Stack {
  static constexpr int kMostFrames = 10;
  uint64_t hash = 1469598103934665603U;
  int num_frames = 0;
};

_Unwind_Reason_Code AddFrame(_Unwind_Context* context, void* stack_of_all) {
  auto& stack = *static_cast<Stack*>(stack_of_all);
  if (const uint64_t place = OwnPlace(_Unwind_GetIP(context)); place != 0) {
    stack.hash = (stack.hash ^ place) * 1099511628211U;
    stack.hash ^= stack.hash >> 29;
    ++stack.num_frames;
  }
  return stack.num_frames < Stack::kMostFrames ? _URC_NO_REASON : _URC_END_OF_STACK;
}

// Never 0.
uint64_t StackHash() {
  Stack stack;
  _Unwind_Backtrace(&AddFrame, &stack);
  return stack.hash | 1;
}

// The stacks that were met, an open hash table.
constexpr size_t kMostStacks = size_t{1} << 18;
std::atomic<uint64_t> stacks[kMostStacks];
bool keeps_stacks = false;
uint64_t fails_stack = 0;

void KeepStack(uint64_t hash) {
  for (size_t i = hash % kMostStacks;; i = (i + 1) % kMostStacks) {
    uint64_t there = 0;
    if (stacks[i].compare_exchange_strong(there, hash) || there == hash) return;
  }
}

// True for the one call that is to fail.
bool Fails(Call call) {
  if (call != chosen || !in_main) return false;
  if (!keeps_stacks && fails_stack == 0) return ++count == fails_at;
  const uint64_t hash = StackHash();
  if (keeps_stacks) KeepStack(hash);
  return hash == fails_stack && ++count == 1;
}

bool FailsFrom(const void* caller) {
  if (chosen != Call::kMemory || !in_main) return false;
  return OwnPlace(reinterpret_cast<uintptr_t>(caller)) != 0 && Fails(Call::kMemory);
}

int KeepOwnCode(dl_phdr_info* info, size_t, void*) {
  const char* name = info->dlpi_name;
  const bool is_own = name[0] == '\0' || std::strstr(name, "libstdc++") != nullptr;
  for (int i = 0; is_own && i < info->dlpi_phnum && num_own < 2; ++i) {
    const auto& part = info->dlpi_phdr[i];
    if (part.p_type != PT_LOAD || (part.p_flags & PF_X) == 0) continue;
    const uintptr_t begin = info->dlpi_addr + part.p_vaddr;
    own_code[num_own++] = {begin, begin + part.p_memsz};
  }
  return 0;
}

Call FromName(const char* name) {
  constexpr const char* kNames[] = {"",       "memory", "read", "write",  "create",
                                    "rename", "sync",   "map",  "thread", "power"};
  for (int i = 1; name != nullptr && i < 10; ++i) {
    if (std::strcmp(name, kNames[i]) == 0) return static_cast<Call>(i);
  }
  return Call::kNone;
}

// A file by system calls alone, as all others may be the shim's; -1 where it is not asked for.
int ReportFile(const char* variable) {
  const char* file = std::getenv(variable);
  if (file == nullptr) return -1;
  return static_cast<int>(syscall(SYS_openat, AT_FDCWD, file, O_WRONLY | O_CREAT | O_TRUNC, 0644));
}

void ReportCount() {
  const int descriptor = ReportFile("RAYLIFT_FAULT_REPORT");
  if (descriptor < 0) return;
  char text[32];
  const int size = std::snprintf(text, sizeof(text), "%ld\n", count.load());
  syscall(SYS_write, descriptor, text, size);
  syscall(SYS_close, descriptor);
}

void ReportStacks() {
  const int descriptor = ReportFile("RAYLIFT_FAULT_STACKS");
  if (descriptor < 0) return;
  for (const std::atomic<uint64_t>& stack : stacks) {
    if (stack == 0) continue;
    char text[32];
    const int size = std::snprintf(text, sizeof(text), "%016lx\n", stack.load());
    syscall(SYS_write, descriptor, text, size);
  }
  syscall(SYS_close, descriptor);
}

int journal = -1;
std::atomic<int> num_kept = 0;

// Ends the process at the chosen call; others are counted.
void LosePower() {
  if (Fails(Call::kPower)) syscall(SYS_kill, syscall(SYS_getpid), SIGKILL);
}

void Journal(const char* what, const char* file, const char* more = "", const char* kept = "") {
  if (journal < 0 || !in_main) return;
  char text[4 * PATH_MAX];
  const int size = std::snprintf(text, sizeof(text), "%s\t%s\t%s\t%s\n", what, file, more, kept);
  syscall(SYS_write, journal, text, size);
}

// All of the file that is there now, or the names in a folder.
void JournalSync(const char* what, int descriptor) {
  char link[64], file[PATH_MAX] = {}, bytes[32];
  std::snprintf(link, sizeof(link), "/proc/self/fd/%d", descriptor);
  if (journal < 0 || syscall(SYS_readlink, link, file, sizeof(file) - 1) < 0) return;
  struct stat status {};
  fstat(descriptor, &status);
  std::snprintf(bytes, sizeof(bytes), "%ld", static_cast<long>(status.st_size));
  Journal(what, file, bytes);
}

// The file that is to be replaced stays under another name, which the journal has.
void KeepReplaced(const char* file, char (&kept)[PATH_MAX]) {
  const char* const name = std::getenv("RAYLIFT_FAULT_JOURNAL");
  std::snprintf(kept, sizeof(kept), "%s.%d", name, ++num_kept);
  if (syscall(SYS_linkat, AT_FDCWD, file, AT_FDCWD, kept, 0) != 0) kept[0] = 0;
}

int Synced(int result, const char* what, int descriptor) {
  if (result == 0) JournalSync(what, descriptor);
  return result;
}

int (*real_main)(int, char**, char**) = nullptr;

int CountedMain(int argc, char** argv, char** environment) {
  dl_iterate_phdr(&KeepOwnCode, nullptr);
  chosen = FromName(std::getenv("RAYLIFT_FAULT_CALL"));
  const char* at = std::getenv("RAYLIFT_FAULT_AT");
  fails_at = at != nullptr ? std::atol(at) : 0;
  keeps_stacks = std::getenv("RAYLIFT_FAULT_STACKS") != nullptr;
  const char* stack = std::getenv("RAYLIFT_FAULT_STACK");
  fails_stack = stack != nullptr ? std::strtoull(stack, nullptr, 16) : 0;
  journal = ReportFile("RAYLIFT_FAULT_JOURNAL");
  in_main = true;
  const int code = real_main(argc, argv, environment);
  in_main = false;
  ReportCount();
  ReportStacks();
  return code;
}

template <typename Function>
Function Next(Function, const char* name) {
  return reinterpret_cast<Function>(dlsym(RTLD_NEXT, name));
}
#define NEXT(function) static const auto next = Next(&function, #function)

int FailWith(int error) {
  errno = error;
  return -1;
}

bool MakesFile(const char* mode) { return mode[0] == 'w' || mode[0] == 'a'; }

void* New(size_t size, size_t alignment, const void* caller) {
  void* memory = nullptr;
  if (!FailsFrom(caller)) {
    memory = alignment > alignof(std::max_align_t) ? __libc_memalign(alignment, size)
                                                   : __libc_malloc(size);
  }
  return memory;
}

void* NewOrThrow(size_t size, size_t alignment, const void* caller) {
  void* const memory = New(size, alignment, caller);
  if (memory != nullptr) return memory;
  if (const std::new_handler handler = std::get_new_handler()) handler();
  throw std::bad_alloc();
}

}  // namespace

#define CALLER __builtin_return_address(0)

void* operator new(size_t size) { return NewOrThrow(size, 0, CALLER); }
void* operator new[](size_t size) { return NewOrThrow(size, 0, CALLER); }
void* operator new(size_t size, std::align_val_t alignment) {
  return NewOrThrow(size, static_cast<size_t>(alignment), CALLER);
}
void* operator new[](size_t size, std::align_val_t alignment) {
  return NewOrThrow(size, static_cast<size_t>(alignment), CALLER);
}
void* operator new(size_t size, const std::nothrow_t&) noexcept { return New(size, 0, CALLER); }
void* operator new[](size_t size, const std::nothrow_t&) noexcept { return New(size, 0, CALLER); }

extern "C" {

int __libc_start_main(int (*main)(int, char**, char**), int argc, char** argv, void (*init)(),
                      void (*fini)(), void (*rtld_fini)(), void* stack_end) {
  using Start =
      int (*)(int (*)(int, char**, char**), int, char**, void (*)(), void (*)(), void (*)(), void*);
  real_main = main;
  const auto start = reinterpret_cast<Start>(dlsym(RTLD_NEXT, "__libc_start_main"));
  return start(&CountedMain, argc, argv, init, fini, rtld_fini, stack_end);
}

void* malloc(size_t size) {
  if (!FailsFrom(CALLER)) return __libc_malloc(size);
  errno = ENOMEM;
  return nullptr;
}

ssize_t read(int descriptor, void* buffer, size_t size) {
  NEXT(read);
  return Fails(Call::kRead) ? FailWith(EIO) : next(descriptor, buffer, size);
}
ssize_t readv(int descriptor, const iovec* parts, int number) {
  NEXT(readv);
  return Fails(Call::kRead) ? FailWith(EIO) : next(descriptor, parts, number);
}
ssize_t pread(int descriptor, void* buffer, size_t size, off_t offset) {
  NEXT(pread);
  return Fails(Call::kRead) ? FailWith(EIO) : next(descriptor, buffer, size, offset);
}
ssize_t pread64(int descriptor, void* buffer, size_t size, off64_t offset) {
  NEXT(pread64);
  return Fails(Call::kRead) ? FailWith(EIO) : next(descriptor, buffer, size, offset);
}

// What is said on stdout and stderr is no file.
ssize_t write(int descriptor, const void* buffer, size_t size) {
  NEXT(write);
  const bool fails = descriptor > STDERR_FILENO && Fails(Call::kWrite);
  return fails ? FailWith(ENOSPC) : next(descriptor, buffer, size);
}
ssize_t writev(int descriptor, const iovec* parts, int number) {
  NEXT(writev);
  const bool fails = descriptor > STDERR_FILENO && Fails(Call::kWrite);
  return fails ? FailWith(ENOSPC) : next(descriptor, parts, number);
}
ssize_t pwrite(int descriptor, const void* buffer, size_t size, off_t offset) {
  NEXT(pwrite);
  return Fails(Call::kWrite) ? FailWith(ENOSPC) : next(descriptor, buffer, size, offset);
}
ssize_t pwrite64(int descriptor, const void* buffer, size_t size, off64_t offset) {
  NEXT(pwrite64);
  return Fails(Call::kWrite) ? FailWith(ENOSPC) : next(descriptor, buffer, size, offset);
}

int open(const char* file, int flags, ...) {
  NEXT(open);
  va_list more;
  va_start(more, flags);
  const int mode = (flags & O_CREAT) != 0 ? va_arg(more, int) : 0;
  va_end(more);
  const bool fails = (flags & O_CREAT) != 0 && Fails(Call::kCreate);
  return fails ? FailWith(ENOSPC) : next(file, flags, mode);
}
int open64(const char* file, int flags, ...) {
  NEXT(open64);
  va_list more;
  va_start(more, flags);
  const int mode = (flags & O_CREAT) != 0 ? va_arg(more, int) : 0;
  va_end(more);
  const bool fails = (flags & O_CREAT) != 0 && Fails(Call::kCreate);
  return fails ? FailWith(ENOSPC) : next(file, flags, mode);
}
FILE* fopen(const char* file, const char* mode) {
  NEXT(fopen);
  if (!MakesFile(mode) || !Fails(Call::kCreate)) return next(file, mode);
  errno = ENOSPC;
  return nullptr;
}
FILE* fopen64(const char* file, const char* mode) {
  NEXT(fopen64);
  if (!MakesFile(mode) || !Fails(Call::kCreate)) return next(file, mode);
  errno = ENOSPC;
  return nullptr;
}
int mkdir(const char* folder, mode_t mode) noexcept {
  NEXT(mkdir);
  LosePower();
  const int result = Fails(Call::kCreate) ? FailWith(ENOSPC) : next(folder, mode);
  if (result == 0) Journal("mkdir", folder);
  return result;
}

int rename(const char* from, const char* to) noexcept {
  NEXT(rename);
  LosePower();
  char kept[PATH_MAX] = {};
  if (journal >= 0) KeepReplaced(to, kept);
  const int result = Fails(Call::kRename) ? FailWith(EIO) : next(from, to);
  if (result == 0) Journal("rename", from, to, kept);
  return result;
}

int fsync(int descriptor) {
  NEXT(fsync);
  LosePower();
  return Fails(Call::kSync) ? FailWith(EIO) : Synced(next(descriptor), "sync", descriptor);
}
int fdatasync(int descriptor) {
  NEXT(fdatasync);
  LosePower();
  return Fails(Call::kSync) ? FailWith(EIO) : Synced(next(descriptor), "sync", descriptor);
}
int syncfs(int descriptor) noexcept {
  NEXT(syncfs);
  LosePower();
  return Fails(Call::kSync) ? FailWith(EIO) : Synced(next(descriptor), "all", descriptor);
}

void* mmap(void* address, size_t size, int protection, int flags, int descriptor,
           off_t offset) noexcept {
  NEXT(mmap);
  if (!Fails(Call::kMap)) return next(address, size, protection, flags, descriptor, offset);
  errno = ENOMEM;
  return MAP_FAILED;
}
void* mmap64(void* address, size_t size, int protection, int flags, int descriptor,
             off64_t offset) noexcept {
  NEXT(mmap64);
  if (!Fails(Call::kMap)) return next(address, size, protection, flags, descriptor, offset);
  errno = ENOMEM;
  return MAP_FAILED;
}

int pthread_create(pthread_t* thread, const pthread_attr_t* attributes, void* (*work)(void*),
                   void* argument) noexcept {
  NEXT(pthread_create);
  return Fails(Call::kThread) ? EAGAIN : next(thread, attributes, work, argument);
}

}  // extern "C"
