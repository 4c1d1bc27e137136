#define RAYLIFT_KERNEL_BYTES 64
#include "estimation/kernels/kernels_impl.h"

namespace raylift::kernels {

const KernelTable& KernelTableAvx512() {
  static constexpr KernelTable kTable = MakeKernelTable();
  return kTable;
}

}  // namespace raylift::kernels
