"""From passes to pictures: noise, what ends passes, files, denoising, comparison."""
