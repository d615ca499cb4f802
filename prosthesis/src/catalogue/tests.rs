//! The catalogue of blocks: adding, taking and returning them, the choice of the smallest, refusals, and several stations at once.

use super::stock::LeaseEntry;
use super::*;

fn text<T: std::fmt::Debug>(result: Result<T, CatalogueError>) -> String {
    result.unwrap_err().to_string()
}

#[test]
fn what_is_added_is_listed_taken_and_put_back() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("stock.toml");
    assert!(text(Catalogue::open(&path)).contains("there is no catalogue"));
    let stock = Catalogue::open_or_create(&path).unwrap();
    stock.add("B2", [60.0, 25.0, 55.0], 1).unwrap();
    stock.add("B1", [80.0, 30.0, 70.0], 2).unwrap();
    stock.add("B1", [80.0, 30.0, 70.0], 1).unwrap();
    drop(stock);
    let stock = Catalogue::open(&path).unwrap();
    let kinds: Vec<_> = stock.list().unwrap().into_iter().map(|b| (b.id, b.count)).collect();
    assert_eq!(kinds, [("B1".to_owned(), 3), ("B2".to_owned(), 1)]);
    assert_eq!(stock.take("B2").unwrap().count, 0);
    assert_eq!(text(stock.take("B2")), "there is no block B2 left");
    assert_eq!(stock.put_back("B2").unwrap().count, 1);
    assert_eq!(text(stock.put_back("B9")), "the catalogue has no block B9");
    assert_eq!(text(stock.take("B9")), "the catalogue has no block B9");
}

#[test]
fn what_makes_no_sense_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let stock = Catalogue::open_or_create(&dir.path().join("stock.toml")).unwrap();
    stock.add("B1", [60.0, 25.0, 55.0], 1).unwrap();
    assert!(text(stock.add("B1", [60.0, 25.0, 50.0], 1)).contains("give the new kind a number of its own"));
    assert!(text(stock.add("B2", [60.0, 0.0, 50.0], 1)).contains("a side of 0 mm"));
    assert!(text(stock.add("B2", [60.0, f64::NAN, 50.0], 1)).contains("a side of NaN mm"));
    assert!(text(stock.add("a,b", [60.0, 25.0, 50.0], 1)).contains("no block's number"));
    assert!(text(stock.add("B1", [60.0, 25.0, 55.0], u32::MAX)).contains("at most 1000000"));
    assert_eq!(stock.list().unwrap().len(), 1);
    // sides in another order are the same block; a wrong one is removed and added
    stock.add("B1", [25.0, 55.0, 60.0], 1).unwrap();
    assert_eq!(
        stock.list().unwrap()[0],
        StockBlock { id: "B1".into(), size_mm: [60.0, 25.0, 55.0], count: 2 }
    );
    assert_eq!(stock.remove("B1").unwrap().count, 2);
    assert_eq!(text(stock.remove("B1")), "the catalogue has no block B1");
    stock.add("B1", [60.0, 25.0, 50.0], 1).unwrap();
}

#[test]
fn a_lease_ends_however_its_holder_does() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("stock.toml");
    let stock = Catalogue::open_or_create(&path).unwrap();
    stock.add("B1", [60.0, 25.0, 55.0], 1).unwrap();
    stock.add("B2", [80.0, 30.0, 70.0], 1).unwrap();
    let counts =
        || Catalogue::open(&path).unwrap().list().unwrap().iter().map(|b| b.count).collect::<Vec<_>>();
    let files = || std::fs::read_dir(dir.path()).unwrap().count();
    let needed_mm = [50.0, 20.0, 50.0];
    let lease = stock.lease_smallest(needed_mm, None).unwrap().unwrap();
    assert_eq!((lease.mounted.id.as_str(), counts()), ("B1", vec![0, 1]));
    // held: the next one gets the other block
    let other = stock.lease_smallest(needed_mm, None).unwrap().unwrap();
    assert_eq!((other.mounted.id.as_str(), counts()), ("B2", vec![0, 0]));
    drop(other);
    assert_eq!(counts(), [0, 1]);
    lease.keep().unwrap();
    // the catalogue and its lock
    assert_eq!((counts(), files()), (vec![0, 1], 2));
    // the plan that is replaced holds its block: it may have it again, or give it back for another
    let again = stock.lease_smallest(needed_mm, Some("B1")).unwrap().unwrap();
    assert_eq!((again.mounted.id.as_str(), counts()), ("B1", vec![0, 1]));
    again.keep().unwrap();
    assert_eq!(counts(), [0, 1]);
    drop(stock.lease_smallest(needed_mm, Some("B1")).unwrap());
    assert_eq!(counts(), [0, 1]);
    let larger = stock.lease_smallest([70.0, 20.0, 50.0], Some("B1")).unwrap().unwrap();
    assert_eq!((larger.mounted.id.as_str(), counts()), ("B2", vec![0, 0]));
    larger.keep().unwrap();
    assert_eq!(counts(), [1, 0]);
    // a kind that is removed meanwhile does not go back, and the plan keeps its block all the same
    let again = stock.lease_smallest(needed_mm, Some("B2")).unwrap().unwrap();
    stock.remove("B2").unwrap();
    again.keep().unwrap();
    assert_eq!(counts(), [0]);
    stock.add("B2", [80.0, 30.0, 70.0], 0).unwrap();
    stock.put_back("B1").unwrap();
    // a holder that was killed: its entry is there, its lock is not
    let held = |stock: &mut Stock| {
        stock.leases.push(LeaseEntry { holder: "77-7".into(), block: Some("B1".into()) });
        stock.take("B1")
    };
    stock.change(held).unwrap();
    // listed as there at once, put back by the next change
    assert_eq!((counts(), Stock::read(&path).unwrap().leases.len()), (vec![1, 0], 1));
    stock.put_back("B2").unwrap();
    assert_eq!(Stock::read(&path).unwrap().leases, []);
    assert_eq!((counts(), files()), (vec![1, 1], 2));
}

#[test]
fn a_catalogue_is_listed_while_another_station_changes_it_and_a_corrupted_one_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("stock.toml");
    let stock = Catalogue::open_or_create(&path).unwrap();
    stock.add("B1", [60.0, 25.0, 55.0], 1).unwrap();
    stock
        .change(|_| {
            assert_eq!(Catalogue::open(&path).unwrap().list().unwrap().len(), 1);
            Ok(())
        })
        .unwrap();
    drop(stock);
    let text = std::fs::read_to_string(&path).unwrap();
    let with = |from: &str, to: &str| {
        assert!(text.contains(from), "{text}");
        std::fs::write(&path, text.replace(from, to)).unwrap();
        let Err(said) = Catalogue::open(&path) else { panic!("{to}") };
        said.to_string()
    };
    for (from, to, says) in [
        ("count = 1", "count = -1", "line 7: invalid value: integer `-1`, expected u32"),
        ("count = 1", "number = 1", "line 7: unknown field `number`"),
        ("60.0", "0.5", "block B1: a side of 0.5 mm; expected 1 to 1000 mm"),
        ("60.0", "nan", "block B1: a side of NaN mm"),
        ("version = 1", "version = 2", "its version is 2, expected 1"),
        ("[[block]]", "[[block]", "line 4: "),
        (
            "[[block]]",
            "[[block]]\nid = \"B1\"\nsize_mm = [9, 9, 9]\ncount = 1\n[[block]]",
            "block B1 is there twice",
        ),
    ] {
        let said = with(from, to);
        assert!(said.contains("stock.toml is no catalogue of blocks") && said.contains(says), "{to}: {said}");
    }
    std::fs::write(&path, [0xFF; 64]).unwrap();
    assert!(self::text(Catalogue::open(&path)).contains("it is no text"));
}

#[test]
fn a_file_of_somebody_else_is_left_alone() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("notes.txt");
    std::fs::write(&path, "these are my notes, a few lines of them, and no database at all; ".repeat(20))
        .unwrap();
    let before = std::fs::read(&path).unwrap();
    assert!(text(Catalogue::open_or_create(&path)).contains("is no catalogue of blocks"));
    assert_eq!(std::fs::read(&path).unwrap(), before);
    // nor is one that lost its bytes a new one
    let empty = dir.path().join("empty.toml");
    std::fs::write(&empty, "").unwrap();
    for opened in [Catalogue::open(&empty), Catalogue::open_or_create(&empty)] {
        assert!(text(opened).contains("empty.toml is no catalogue of blocks"));
    }
    assert_eq!(std::fs::read(&empty).unwrap(), b"");
    let other = dir.path().join("other.toml");
    std::fs::write(&other, "[mine]\nx = 1\n").unwrap();
    assert!(text(Catalogue::open_or_create(&other)).contains("is no catalogue of blocks"));
}

#[test]
fn the_smallest_block_that_holds_the_box_is_chosen_and_turned_to_fit() {
    let block = |id: &str, size_mm, count| StockBlock { id: id.into(), size_mm, count };
    let blocks = [
        block("large", [80.0, 30.0, 70.0], 1),
        block("flat", [55.0, 60.0, 20.0], 1),
        block("gone", [45.0, 18.0, 54.0], 0),
        block("thin", [200.0, 200.0, 10.0], 9),
    ];
    let mounted = smallest(&blocks, [41.0, 16.0, 54.0]).unwrap();
    // the thin side across y, then the shorter one along x
    assert_eq!((mounted.id.as_str(), mounted.size_mm), ("flat", [55.0, 20.0, 60.0]));
    assert_eq!(smallest(&blocks, [41.0, 16.0, 61.0]).unwrap().id, "large");
    assert_eq!(smallest(&blocks, [90.0, 16.0, 61.0]), None);
}

#[test]
fn of_many_stations_that_want_the_last_blocks_each_gets_its_own() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("stock.toml");
    Catalogue::open_or_create(&path).unwrap().add("B1", [60.0, 25.0, 55.0], 5).unwrap();
    let station = |n: usize| {
        let path = path.clone();
        std::thread::spawn(move || {
            let stock = Catalogue::open(&path).unwrap();
            if n.is_multiple_of(2) {
                stock.take("B1").is_ok()
            } else {
                stock
                    .lease_smallest([1.0; 3], None)
                    .unwrap()
                    .map(Lease::keep)
                    .is_some_and(|kept| kept.is_ok())
            }
        })
    };
    let stations: Vec<_> = (0..8).map(station).collect();
    let got: Vec<bool> = stations.into_iter().map(|s| s.join().unwrap()).collect();
    assert_eq!(got.iter().filter(|got| **got).count(), 5, "{got:?}");
    assert_eq!(Catalogue::open(&path).unwrap().list().unwrap()[0].count, 0);
}
