//! Work over the threads of the pool.

/// `of` each number below `count`, in order, on the threads of the pool, unless this is one of them: while it waited, it might take
/// up work that waits for this. A browser's page has one thread.
pub fn on_all_threads<T: Send>(count: usize, of: impl Fn(usize) -> T + Send + Sync) -> Vec<T> {
    #[cfg(not(target_family = "wasm"))]
    if rayon::current_thread_index().is_none() {
        use rayon::prelude::*;
        return (0..count).into_par_iter().map(of).collect();
    }
    (0..count).map(of).collect()
}
